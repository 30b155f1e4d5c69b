//! A log that is open: its header, and rows that wait for a flush.

use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;
use std::time::Duration;

use super::RecordError;
use crate::date;
use crate::recording::{Entry, Header, RECORDED_FROM, Writer};

/// Rows that wait for a flush, besides the header, bytes.
const BUFFER: usize = 8192;

pub(super) struct OpenLog {
    pub(super) path: PathBuf,
    writer: Writer<BufWriter<File>>,
}

impl OpenLog {
    /// Writes the header, with the time of its first reading, since 1970, unless it has that of a replayed log.
    pub(super) fn begin(
        path: PathBuf,
        file: File,
        header: &Header,
        first: Option<Duration>,
    ) -> Result<Self, RecordError> {
        let mut header = header.clone();
        if header.recorded_from().is_none()
            && let Some(time) = first.map(date::rfc3339)
        {
            header.truth.push((RECORDED_FROM.to_owned(), time));
        }
        // The buffer holds the whole header: on a full disk the flush fails, and is retried.
        let buffer = BufWriter::with_capacity(BUFFER + header.text().len(), file);
        let writer = Writer::new(buffer, &header).map_err(RecordError::of(true, &path))?;
        Ok(Self { path, writer })
    }

    pub(super) fn write(&mut self, entry: &Entry) -> Result<u64, RecordError> {
        let length = self.writer.write(entry);
        Ok(length.map_err(RecordError::of(false, &self.path))? as u64)
    }

    pub(super) fn flush(&mut self) -> Result<(), RecordError> {
        let flushed = self.writer.flush();
        flushed.map_err(RecordError::of(false, &self.path))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_header_of_any_length_waits_for_a_disk_that_is_full() {
        let header = Header {
            truth: vec![("remark".to_owned(), "x".repeat(3 * BUFFER))],
            ..Header::default()
        };
        let path = PathBuf::from("/dev/full");
        let file = File::options().write(true).open(&path).unwrap();
        let mut log = OpenLog::begin(path, file, &header, None).unwrap();
        assert!(log.flush().is_err());
    }
}
