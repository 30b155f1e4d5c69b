//! Declaring settings and words, and checking settings: every fault is collected, with its key, what was found and what
//! would be right.

use std::fmt;
use std::ops::RangeInclusive;
use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;

/// One setting that cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{key} is {found}, but must be {right}")]
pub struct Fault {
    /// The key as written in the configuration, without its table: `angle_deg`.
    pub key: String,
    /// What was found.
    pub found: String,
    /// What would be right: a range with its unit, or a sentence.
    pub right: String,
}

impl Fault {
    /// A fault of the setting `key`.
    pub fn new(key: &str, found: impl Into<String>, right: impl Into<String>) -> Self {
        Self {
            key: key.to_owned(),
            found: found.into(),
            right: right.into(),
        }
    }
}

/// Settings of a table of the configuration, which can say what is wrong with themselves.
pub trait Check: Default + Serialize + DeserializeOwned {
    /// Their keys, as in the file: the names of the fields.
    const KEYS: &[&str];

    /// Every key that is wrong by itself.
    fn check_keys(&self) -> Vec<Fault>;

    /// Collects what is wrong between keys.
    fn compare_keys(&self, _faults: &mut Vec<Fault>) {}

    /// Every fault at once; empty when all is well. Keys are compared once each is right by itself: what follows from a wrong
    /// one is no fault of the other.
    fn check(&self) -> Vec<Fault> {
        let mut faults = self.check_keys();
        if faults.is_empty() {
            self.compare_keys(&mut faults);
        }
        faults
    }
}

/// Collects a fault unless `value` lies in `range`. NaN never does.
pub fn within<T>(faults: &mut Vec<Fault>, key: &str, value: T, range: RangeInclusive<T>, unit: &str)
where
    T: PartialOrd + fmt::Display,
{
    if !range.contains(&value) {
        let unit = if unit.is_empty() {
            String::new()
        } else {
            format!(" {unit}")
        };
        let right = format!("from {} to {}{unit}", range.start(), range.end());
        faults.push(Fault::new(key, value.to_string(), right));
    }
}

/// What a key's own check finds. Its bound gives a closure's arguments their types.
pub fn checked<T>(
    key: &str,
    value: &T,
    check: impl Fn(&str, &T) -> Option<Fault>,
) -> Option<Fault> {
    check(key, value)
}

/// A fault unless `path` is absolute, or empty.
pub fn absolute_or_empty(key: &str, path: &Path, right: &str) -> Option<Fault> {
    let wrong = path.is_relative() && !path.as_os_str().is_empty();
    wrong.then(|| Fault::new(key, format!("{path:?}"), right))
}

/// The numbers of a setting: one, some, or none.
pub trait Numbers {
    /// What they are.
    type Number: PartialOrd + fmt::Display;

    /// All of them.
    fn numbers(&self) -> Vec<Self::Number>;
}

macro_rules! single {
    ($($number:ty)*) => {$(
        impl Numbers for $number {
            type Number = Self;

            fn numbers(&self) -> Vec<Self> {
                vec![*self]
            }
        }
    )*};
}

single!(f64 u8 u32 u64 usize);

impl<T: Numbers> Numbers for Option<T> {
    type Number = T::Number;

    fn numbers(&self) -> Vec<T::Number> {
        self.iter().flat_map(T::numbers).collect()
    }
}

impl<T: Numbers, const N: usize> Numbers for [T; N] {
    type Number = T::Number;

    fn numbers(&self) -> Vec<T::Number> {
        self.iter().flat_map(T::numbers).collect()
    }
}

/// Declares settings: each key once, with its default; where it is a number, its range and unit; and after `=>` a check of
/// the value, `|key, value|`. `compares` names a function that collects the faults between keys.
macro_rules! settings {
    (
        $(#[$about:meta])*
        pub struct $name:ident {
            $(
                $(#[$key_about:meta])*
                $key:ident: $type:ty = $default:expr $(, $range:expr, $unit:literal)? $(=> $check:expr)?;
            )*
        }
        $(compares $compares:path;)?
    ) => {
        $(#[$about])*
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct $name {
            $(
                $(#[$key_about])*
                $(#[doc = concat!("\n", stringify!($range), " ", $unit)])?
                pub $key: $type,
            )*
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $($key: $default,)* }
            }
        }

        impl $crate::check::Check for $name {
            const KEYS: &[&str] = &[$(stringify!($key)),*];

            fn check_keys(&self) -> Vec<$crate::check::Fault> {
                #[allow(unused_mut, reason = "some settings can be nothing but right")]
                let mut faults = Vec::new();
                $(
                    $(for number in $crate::check::Numbers::numbers(&self.$key) {
                        $crate::check::within(&mut faults, stringify!($key), number, $range, $unit);
                    })?
                    $(faults.extend($crate::check::checked(stringify!($key), &self.$key, $check));)?
                )*
                faults
            }

            $(
                fn compare_keys(&self, faults: &mut Vec<$crate::check::Fault>) {
                    $compares(self, faults);
                }
            )?
        }
    };
}

/// Declares an enum of words: each variant once, with its word as published and kept.
macro_rules! words {
    (
        $(#[$about:meta])*
        pub enum $name:ident {
            $($(#[$word_about:meta])* $variant:ident = $word:literal,)*
        }
    ) => {
        #[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
        $(#[$about])*
        pub enum $name {
            $($(#[$word_about])* #[serde(rename = $word)] $variant,)*
        }

        impl $name {
            /// All words.
            pub const WORDS: &[&str] = &[$($word),*];

            /// The word as published and kept.
            pub fn word(self) -> &'static str {
                match self {
                    $(Self::$variant => $word,)*
                }
            }
        }
    };
}

pub(crate) use {settings, words};
