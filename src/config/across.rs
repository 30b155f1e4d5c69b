//! What is wrong between tables, and what a table cannot say of itself.

use super::{Config, source};
use crate::check::Fault;
use crate::position::Gpsd;

impl Config {
    /// What is wrong between tables that are right in themselves, each fault with the key that its own contradicts. The keys are
    /// `table.key`.
    pub(super) fn check_across(&self) -> Vec<(Fault, &'static str)> {
        let mut faults = Vec::new();
        if self.source.kind == Some(source::Kind::Serial) && self.serial.port.as_os_str().is_empty()
        {
            let right = "the path of the serial port, best one in /dev/serial/by-id";
            faults.push((Fault::new("serial.port", "empty", right), "source.kind"));
        }
        if self.control.path(&self.socket.socket) == self.socket.socket {
            let found = format!("{:?}, as socket.socket is", self.socket.socket);
            let right = "another path than that of the socket for headings";
            let fault = Fault::new("control.socket", found, right);
            faults.push((fault, "socket.socket"));
        }
        faults
    }

    /// What is wrong with the address of a gpsd, which its own table cannot parse.
    pub(super) fn check_gpsd(&self) -> Vec<Fault> {
        let gpsd = &self.true_north.gpsd;
        if gpsd.is_empty() || Gpsd::parse(gpsd).is_some() {
            return Vec::new();
        }
        let right =
            "an address in numbers with a port, as \"127.0.0.1:2947\", an absolute path, or empty";
        vec![Fault::new("true_north.gpsd", format!("{gpsd:?}"), right)]
    }
}
