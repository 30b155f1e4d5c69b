//! A bus for tests: chips are tables of registers, every transfer is recorded, and faults are scripted.

use std::cell::RefCell;
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;

use super::{Bus, BusError, Cause};

/// A transfer that was made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Transfer {
    /// Chip, first register, number of registers.
    Read(u8, u8, u8),
    /// Chip, register, value.
    Write(u8, u8, u8),
}

/// What is behind a [`FakeBus`].
#[derive(Default)]
pub(crate) struct World {
    /// The registers of each chip that answers.
    pub(crate) chips: BTreeMap<u8, [u8; 128]>,
    /// Every transfer, failed ones too.
    pub(crate) transfers: Vec<Transfer>,
    /// The next faults of a chip.
    pub(crate) faults: BTreeMap<u8, VecDeque<Cause>>,
    /// Every transfer fails like this.
    pub(crate) broken: Option<Cause>,
    /// What a chip does when it is written to: chip, register, value. The table has the value already.
    pub(crate) on_write: Option<fn(&mut World, u8, u8, u8)>,
}

impl World {
    /// Sets registers of a chip, which is there from now on.
    pub(crate) fn set(&mut self, address: u8, register: u8, values: &[u8]) {
        let registers = self.chips.entry(address).or_insert([0; 128]);
        registers[usize::from(register)..][..values.len()].copy_from_slice(values);
    }

    /// A register of a chip.
    pub(crate) fn get(&self, address: u8, register: u8) -> u8 {
        self.chips[&address][usize::from(register)]
    }

    fn fails(&mut self, address: u8) -> Option<Cause> {
        let scripted = self.faults.get_mut(&address).and_then(VecDeque::pop_front);
        self.broken
            .clone()
            .or(scripted)
            .or_else(|| (!self.chips.contains_key(&address)).then_some(Cause::NoAnswer))
    }
}

/// One end of the bus; clones share it.
#[derive(Clone, Default)]
pub(crate) struct FakeBus {
    pub(crate) world: Rc<RefCell<World>>,
}

impl FakeBus {
    /// The transfers since the last call.
    pub(crate) fn transfers(&self) -> Vec<Transfer> {
        std::mem::take(&mut self.world.borrow_mut().transfers)
    }

    pub(crate) fn set(&self, address: u8, register: u8, values: &[u8]) {
        self.world.borrow_mut().set(address, register, values);
    }
}

impl Bus for FakeBus {
    fn read(&mut self, address: u8, register: u8, into: &mut [u8]) -> Result<(), BusError> {
        let world = &mut *self.world.borrow_mut();
        let count = into.len() as u8;
        world
            .transfers
            .push(Transfer::Read(address, register, count));
        if let Some(cause) = world.fails(address) {
            return Err(error("read", address, cause));
        }
        let registers = &world.chips[&address][usize::from(register)..];
        into.copy_from_slice(&registers[..into.len()]);
        Ok(())
    }

    fn write(&mut self, address: u8, register: u8, value: u8) -> Result<(), BusError> {
        let world = &mut *self.world.borrow_mut();
        world
            .transfers
            .push(Transfer::Write(address, register, value));
        // A transfer that fails at its end has written.
        if world.broken.is_none() && world.chips.contains_key(&address) {
            world.set(address, register, &[value]);
            if let Some(on_write) = world.on_write {
                on_write(world, address, register, value);
            }
        }
        let failed = world.fails(address);
        failed.map_or(Ok(()), |cause| Err(error("write", address, cause)))
    }
}

pub(crate) fn error(attempt: &str, address: u8, cause: Cause) -> BusError {
    BusError {
        bus: "/dev/i2c-1".to_owned(),
        attempt: attempt.to_owned(),
        address,
        cause,
    }
}
