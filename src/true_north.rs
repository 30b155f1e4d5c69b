//! From magnetic to true north. Pure: the time of day comes in as an argument.

mod model;

use std::ops::RangeInclusive;
use std::time::Duration;

use world_magnetic_model::WarningZone;

use crate::check::{Fault, settings};

pub use model::{EarthField, Position, ValueWithSd};

/// Heights above the ellipsoid for which the model holds, metres.
pub const ALTITUDE_M: RangeInclusive<f64> = -1000.0..=850_000.0;

/// The declination is the same within this, degrees north and east: it changes by some hundredths of a degree.
const NEAR_DEG: f64 = 0.02;

settings! {
    /// Where the declination comes from. Without a position and without a declination there are no true headings.
    pub struct Settings {
        /// Where the compass is, north.
        latitude_deg: Option<f64> = None, -90.0..=90.0, "degrees";
        /// The same, east.
        longitude_deg: Option<f64> = None, -180.0..=180.0, "degrees";
        /// Its height above the ellipsoid of WGS 84; a kilometre changes little.
        altitude_m: f64 = 0.0, ALTITUDE_M, "metres";
        /// How far magnetic north is east of true north, in place of the model's answer.
        declination_deg: Option<f64> = None, -180.0..=180.0, "degrees";
        /// A gpsd that says where the compass is: an address in numbers with a port, or the absolute path of a Unix socket.
        /// Empty: none.
        gpsd: String = String::new();
    }
    compares Settings::check_position;
}

impl Settings {
    /// Where the compass is, if that is set.
    pub fn position(&self) -> Option<Position> {
        Some(Position {
            latitude_deg: self.latitude_deg?,
            longitude_deg: self.longitude_deg?,
            altitude_m: self.altitude_m,
        })
    }

    fn check_position(&self, faults: &mut Vec<Fault>) {
        let (has, lacks) = match (self.latitude_deg, self.longitude_deg) {
            (Some(_), None) => ("latitude_deg", "longitude_deg"),
            (None, Some(_)) => ("longitude_deg", "latitude_deg"),
            _ => return,
        };
        let right = format!("set together with {lacks}");
        faults.push(Fault::new(has, "set alone", right));
    }
}

/// The declination, as long as it is known.
#[derive(Debug, Default)]
pub struct TrueNorth {
    declination_by_hand_deg: Option<f64>,
    position: Option<Position>,
    /// Where and on which day the model was asked last; no day where no date was known.
    asked: Option<(Position, Option<u64>)>,
    /// The field there, where it is known, and whether nobody has taken it yet.
    field: Option<EarthField>,
    field_is_new: bool,
    /// Kind of the last warning.
    told: Option<&'static str>,
    news: Option<String>,
}

impl TrueNorth {
    /// By these settings.
    pub fn new(settings: &Settings) -> Self {
        Self {
            declination_by_hand_deg: settings.declination_deg,
            position: settings.position(),
            ..Self::default()
        }
    }

    /// The compass is there now.
    pub fn put_position(&mut self, position: Position) {
        let near = |there: &Position| {
            let north = (there.latitude_deg - position.latitude_deg).abs();
            let east = (there.longitude_deg - position.longitude_deg).abs();
            north.max(east) < NEAR_DEG
        };
        if !self.position.as_ref().is_some_and(near) {
            self.position = Some(position);
        }
    }

    /// How far magnetic north is east of true north at this time of day, degrees; `None` where that is not known. It is
    /// computed once a day, and where the compass has moved.
    pub fn declination_deg(&mut self, since_1970: Option<Duration>) -> Option<f64> {
        self.ask_model(since_1970);
        let modelled = self.field.map(|field| field.declination_deg.value);
        self.declination_by_hand_deg.or(modelled)
    }

    fn ask_model(&mut self, since_1970: Option<Duration>) {
        let Some(position) = self.position else {
            return;
        };
        let asked = (position, since_1970.map(|since| since.as_secs() / 86_400));
        if self.asked == Some(asked) {
            return;
        }
        let (field, warning) = answer(&position, since_1970);
        // Only on a change. A configured declination needs no warning.
        let (kind, text) = warning.unzip();
        if self.told != kind && self.declination_by_hand_deg.is_none() {
            let again = match self.field {
                None => "true headings again",
                Some(_) => "far enough from the magnetic pole again",
            };
            self.news = Some(text.unwrap_or_else(|| again.to_owned()));
        }
        self.told = kind;
        self.asked = Some(asked);
        self.field = field;
        self.field_is_new = true;
    }

    /// The field there; `None` where the model has none: without a date, and near a magnetic pole, where no compass is to be
    /// relied on.
    pub fn field(&self) -> Option<&EarthField> {
        self.field.as_ref()
    }

    /// The field, if it has been computed since this was last asked.
    pub fn take_field(&mut self) -> Option<Option<EarthField>> {
        std::mem::take(&mut self.field_is_new).then_some(self.field)
    }

    /// Whether the last news was a warning, and not the end of one.
    pub fn is_warning(&self) -> bool {
        self.told.is_some()
    }

    /// What the user should know since the last answer, once.
    pub fn news(&mut self) -> Option<String> {
        self.news.take()
    }
}

/// The field, where its declination is to be relied on, and the warning about it with its kind.
fn answer(
    position: &Position,
    since_1970: Option<Duration>,
) -> (Option<EarthField>, Option<(&'static str, String)>) {
    const REMEDY: &str = "set true_north.declination_deg";
    let Some(since_1970) = since_1970 else {
        let why =
            "the date is not known: the system's clock was never set, or the log does not say it";
        let warning = format!("no true headings: {why}; {REMEDY}");
        return (None, Some(("undated", warning)));
    };
    match EarthField::new(position, since_1970) {
        Err(error) => {
            let warning = format!("no true headings: {error}; {REMEDY}");
            (None, Some(("unknown", warning)))
        }
        Ok(field) => {
            let reliable = field.zone != Some(WarningZone::BlackoutZone);
            let kind = if reliable { "inaccurate" } else { "unreliable" };
            let warning = field.warning().map(|warning| (kind, warning));
            (reliable.then_some(field), warning)
        }
    }
}

impl EarthField {
    /// What a user should know there, near a magnetic pole.
    pub fn warning(&self) -> Option<String> {
        let horizontal = self.horizontal_mgauss.value;
        Some(match self.zone? {
            WarningZone::CautionZone => format!(
                "near a magnetic pole: the horizontal field is {horizontal:.0} mG, and headings are less accurate than \
                 heading_sd says"
            ),
            WarningZone::BlackoutZone => format!(
                "no true headings: so near a magnetic pole, with a horizontal field of {horizontal:.0} mG, no compass \
                 is to be relied on"
            ),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::Check;
    use crate::date::parse_rfc3339;

    fn calgary() -> Settings {
        Settings {
            latitude_deg: Some(51.08),
            longitude_deg: Some(-114.13),
            altitude_m: 1100.0,
            ..Settings::default()
        }
    }

    fn day(text: &str) -> Option<Duration> {
        Some(parse_rfc3339(&format!("{text}T12:00:00Z")).unwrap())
    }

    #[test]
    fn a_position_gives_the_declination_of_the_day_and_nothing_gives_none() {
        let mut north = TrueNorth::new(&calgary());
        let found = north.declination_deg(day("2026-11-21")).unwrap();
        assert!((found - 13.304).abs() < 0.002, "{found}");
        let later = north.declination_deg(day("2028-11-21")).unwrap();
        assert!((found - later).abs() > 0.05, "{later}");
        assert_eq!(north.news(), None);
        let mut none = TrueNorth::new(&Settings::default());
        assert_eq!(none.declination_deg(day("2026-11-21")), None);
        assert_eq!(none.news(), None);
    }

    #[test]
    fn a_compass_that_moves_has_another_declination() {
        let mut north = TrueNorth::new(&Settings::default());
        let mut there = calgary().position().unwrap();
        north.put_position(there);
        let before = north.declination_deg(day("2026-11-21")).unwrap();
        there.latitude_deg += 0.9 * NEAR_DEG;
        north.put_position(there);
        assert_eq!(north.declination_deg(day("2026-11-21")), Some(before));
        there.longitude_deg = 0.0;
        north.put_position(there);
        let london = north.declination_deg(day("2026-11-21")).unwrap();
        assert!((london - before).abs() > 10.0, "{london}");
    }

    #[test]
    fn a_field_that_is_not_known_any_more_is_withdrawn() {
        let mut north = TrueNorth::new(&calgary());
        north.declination_deg(day("2026-11-21"));
        let field = north.take_field().unwrap().unwrap();
        assert!((field.dip_deg.value - 72.0).abs() < 2.0, "{field:?}");
        assert!(north.take_field().is_none());
        let mut there = calgary().position().unwrap();
        (there.latitude_deg, there.longitude_deg) = (86.0, 139.0);
        north.put_position(there);
        north.declination_deg(day("2026-11-21"));
        assert!(north.take_field().unwrap().is_none());
    }

    #[test]
    fn what_stands_in_the_way_is_told_once_and_again_when_it_changes() {
        let mut north = TrueNorth::new(&calgary());
        for _ in 0..2 {
            assert_eq!(north.declination_deg(None), None);
        }
        let told = north.news().unwrap();
        assert!(north.is_warning());
        assert!(told.contains("the date is not known"), "{told}");
        assert_eq!(north.news(), None);
        // Then the clock is set.
        assert!(north.declination_deg(day("2029-12-30")).is_some());
        assert_eq!(north.news().unwrap(), "true headings again");
        assert!(!north.is_warning());
        assert!(north.declination_deg(day("2029-12-31")).is_some());
        assert_eq!(north.news(), None);
        for date in ["2030-01-01", "2030-01-02"] {
            assert_eq!(north.declination_deg(day(date)), None);
            let told = north.news();
            assert_eq!(told.is_some(), date == "2030-01-01", "{told:?}");
        }
        let at_the_pole = Settings {
            latitude_deg: Some(86.0),
            longitude_deg: Some(139.0),
            ..calgary()
        };
        let mut north = TrueNorth::new(&at_the_pole);
        for (date, part) in [(None, "the date is not"), (day("2026-11-21"), "no compass")] {
            assert_eq!(north.declination_deg(date), None);
            assert!(north.news().unwrap().contains(part));
        }
    }

    #[test]
    fn half_a_position_is_refused() {
        assert_eq!(calgary().check(), []);
        let half = Settings {
            longitude_deg: None,
            ..calgary()
        };
        assert_eq!(
            half.check()[0].to_string(),
            "latitude_deg is set alone, but must be set together with longitude_deg"
        );
    }
}
