use std::io::Write;

use super::*;

/// One whose daemon ends: no pause is waited for.
fn recorder(destination: Destination) -> RecorderThread {
    RecorderThread {
        destination,
        header: Header::default(),
        readings: sync_channel(1).1,
        ring_lock: OnceCell::new(),
        written: 0,
        fault: Shared::default(),
    }
}

fn ring_in(folder: &Path) -> Destination {
    Destination::Ring(Settings {
        directory: folder.to_owned(),
        ..Settings::default()
    })
}

#[test]
fn a_full_disk_costs_the_oldest_logs_of_a_ring_but_not_the_newest() {
    let folder = tempfile::tempdir().unwrap();
    for _ in 0..3 {
        let (path, _) = ring::next(folder.path(), 3, 1).unwrap();
        fs::write(path, "row").unwrap();
    }
    let recorder = recorder(ring_in(folder.path()));
    let attempt = |left: usize| {
        recorder.retrying(
            || match fs::read_dir(folder.path()).unwrap().count() > left {
                true => Err(RecordError::of(false, folder.path())(
                    ErrorKind::StorageFull.into(),
                )),
                false => Ok(()),
            },
        )
    };
    assert!(attempt(2).is_ok() && attempt(1).is_ok());
    assert!(folder.path().join("record-000003.csv").exists());
    assert!(attempt(0).is_err());
    assert!(folder.path().join("record-000003.csv").exists());
}

#[test]
fn a_ring_is_one_daemons_at_a_time() {
    let folder = tempfile::tempdir().unwrap();
    let mut lock = File::create(folder.path().join(".lock")).unwrap();
    lock.lock().unwrap();
    writeln!(lock, "17").unwrap();
    let recorder = recorder(ring_in(folder.path()));
    let error = recorder.claim_ring().unwrap_err();
    let message = error.to_string() + &remedy::of_folder(&error.source, "record.directory");
    assert!(message.contains("(process 17)"), "{message}");
    assert!(message.contains("another record.directory"), "{message}");
    lock.unlock().unwrap();
    recorder.claim_ring().unwrap();
}

#[test]
fn a_log_that_is_replaced_is_read_to_its_end() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.csv");
    fs::write(&path, "old").unwrap();
    let reader = File::open(&path).unwrap();
    recorder(Destination::File(path.clone())).open().unwrap();
    assert_eq!(io::read_to_string(reader).unwrap(), "old");
    assert_eq!(fs::read(path).unwrap(), b"");
}
