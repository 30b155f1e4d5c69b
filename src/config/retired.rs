//! Keys of earlier versions that no longer exist: a file that still has them is good, and a warning says what to do instead.

/// Table, key, and what is in its place.
const RETIRED: &[(&str, &str, &str)] = &[
    (
        "heading",
        "strength_tolerance",
        "a disturbance is judged by the estimate's own uncertainty; leave the key out",
    ),
    (
        "heading",
        "misfit_s",
        "a calibration that stops fitting is learnt anew by motion, and is not replaced after a time; leave the key out, and \
         see heading.good_sd_deg",
    ),
    (
        "verdict",
        "sphere_share",
        "motion without a full turn is judged by the estimate's uncertainty; leave the key out, and see heading.good_sd_deg",
    ),
];

/// What to do in place of this key, if it is one that no longer exists.
pub(super) fn instead(table: &str, key: &str) -> Option<&'static str> {
    RETIRED
        .iter()
        .find(|retired| (retired.0, retired.1) == (table, key))
        .map(|retired| retired.2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    #[test]
    fn no_key_is_both_known_and_retired() {
        let tables = Config::tables();
        for (table, key, instead) in RETIRED {
            let known = tables.iter().find(|known| known.name == *table);
            let keys = known.unwrap_or_else(|| panic!("no table {table}")).keys;
            assert!(!keys.contains(key), "{table}.{key}");
            assert!(instead.len() > 20, "{table}.{key}: {instead}");
        }
    }

    #[test]
    fn a_file_with_a_retired_key_is_good_and_says_where_it_stands() {
        let text = "[heading]\nstale_s = 0.7\nmisfit_s = \"long\"\nstrength_tolerance = 0.2\n";
        let config = Config::parse("old.toml", text).unwrap();
        assert_eq!(config.heading.stale_s, 0.7);
        let [first, second] = config.retired.as_slice() else {
            panic!("{:?}", config.retired);
        };
        assert!(
            first.starts_with("line 3: heading.misfit_s no longer exists and has no effect: "),
            "{first}"
        );
        assert!(
            second.starts_with("line 4: heading.strength_tolerance"),
            "{second}"
        );
        // In another table it is as unknown as any other.
        let error = Config::parse("old.toml", "[turn]\nmisfit_s = 1.0").unwrap_err();
        assert!(error.contains("turn.misfit_s: unknown key"), "{error}");
    }
}
