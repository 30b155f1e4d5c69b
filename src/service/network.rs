//! Whether the installed unit lets the daemon reach a network.

use std::fs;
use std::path::Path;

/// Where systemd looks for units, and for drop-ins of one.
const FOLDERS: [&str; 5] = [
    "etc/systemd/system",
    "run/systemd/system",
    "usr/local/lib/systemd/system",
    "usr/lib/systemd/system",
    "lib/systemd/system",
];

const UNIT: &str = "headingd.service";

/// Whether there is a unit of the service under `root`, and no drop-in of it opens the network.
pub fn is_closed(root: &Path) -> bool {
    let installed = FOLDERS
        .iter()
        .any(|folder| root.join(folder).join(UNIT).exists());
    installed && !FOLDERS.iter().any(|folder| opens(&root.join(folder)))
}

/// Whether a drop-in in this folder does.
fn opens(folder: &Path) -> bool {
    let Ok(files) = fs::read_dir(folder.join(format!("{UNIT}.d"))) else {
        return false;
    };
    files.flatten().any(|file| {
        let path = file.path();
        path.extension().is_some_and(|end| end == "conf")
            && fs::read_to_string(&path).is_ok_and(|text| {
                text.lines()
                    .filter_map(|line| line.trim().strip_prefix("PrivateNetwork="))
                    .any(|value| ["no", "false", "off", "0"].contains(&value.trim()))
            })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_is_closed_until_a_drop_in_opens_it() {
        let root = tempfile::tempdir().unwrap();
        let put = |path: &str, text: &str| {
            let path = root.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        assert!(!is_closed(root.path()), "there is none");
        put(
            "usr/lib/systemd/system/headingd.service",
            include_str!("../../systemd/headingd.service"),
        );
        assert!(is_closed(root.path()));
        let example = include_str!("../../systemd/network.conf");
        put(
            "etc/systemd/system/headingd.service.d/network.conf.old",
            example,
        );
        put(
            "etc/systemd/system/headingd.service.d/a.conf",
            "[Service]\n",
        );
        assert!(is_closed(root.path()));
        put(
            "etc/systemd/system/headingd.service.d/network.conf",
            example,
        );
        assert!(!is_closed(root.path()));
    }
}
