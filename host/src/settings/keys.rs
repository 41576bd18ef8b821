//! How a setting is declared: once, with its key, its form in the file, its place, its range and its comment.
//!
//! In: groups of keys ([`keys!`], used in [`super::groups`]). Out: for each group a struct that serde reads, the settings
//! with what it gives, the group's text, the check of its ranges. Leaves out what depends on other settings.

use super::aperture_text::{aperture_text, parse_aperture};
use super::check::{in_range, sensible};
use crate::geometry::aperture::Aperture;
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::configuration::flow_curves::{CURVE_POINTS_MAX, CurvePoints};
use serde::de::DeserializeOwned;
use std::marker::PhantomData;

/// How a setting stands in a machine file.
pub(super) trait Form {
    /// What serde reads: an `Option` where the key may be missing.
    type Given: DeserializeOwned + Clone;
    /// What the setting is.
    type Setting;

    /// The setting that is given; `None` leaves it as it is.
    fn read(given: Self::Given) -> Result<Option<Self::Setting>, Refusal>;

    /// Its text; `None` where the key is left out, which a file with `all` keys has nevertheless.
    fn written(setting: &Self::Setting, all: bool) -> Option<String>;

    /// The number, in the file's unit, that must be in range.
    fn number(_: &Self::Setting) -> Option<f64> {
        None
    }
}

/// Declares a form: what is given, what is set, one to the other and back, and the number that has a range.
macro_rules! form {
    ($(#[$help:meta])* $name:ident: $given:ty => $setting:ty,
     $read:expr, |$value:ident, $all:ident| $written:expr, $number:expr) => {
        $(#[$help])*
        pub(super) struct $name;
        impl Form for $name {
            type Given = Option<$given>;
            type Setting = $setting;
            fn read(given: Option<$given>) -> Result<Option<$setting>, Refusal> {
                let read: fn($given) -> Result<$setting, Refusal> = $read;
                given.map(read).transpose()
            }
            fn written($value: &$setting, $all: bool) -> Option<String> {
                $written
            }
            fn number(setting: &$setting) -> Option<f64> {
                let number: fn(&$setting) -> Option<f64> = $number;
                number(setting)
            }
        }
    };
}

form! {
    /// A number as it is.
    Plain: f64 => f64, Ok, |value, _all| Some(number(*value)), |value| Some(*value)
}
form! {
    /// A number of which 0 asks for nothing: jobs carry the file, so what is not asked for is left out.
    Asked: f64 => f64, Ok, |value, _all| (*value != 0.0).then(|| number(*value)), |value| (*value != 0.0).then_some(*value)
}
form! {
    /// A number that may be missing.
    Known: f64 => Option<f64>, |given| Ok(Some(given)), |value, _all| value.map(number), |value| *value
}
form! {
    /// A whole number.
    Count: u32 => u32, Ok, |value, _all| Some(value.to_string()), |value| Some(f64::from(*value))
}
form! {
    /// A whole number that may be missing.
    KnownCount: u32 => Option<u32>, |given| Ok(Some(given)),
    |value, _all| value.map(|value| value.to_string()), |value| value.map(f64::from)
}
form! {
    /// A whole number of which 1 is left out.
    CountFromTwo: u32 => u32, Ok, |value, all| (all || *value != 1).then(|| value.to_string()), |value| Some(f64::from(*value))
}
form! {
    /// Degrees in the file, radians here.
    Degrees: f64 => f64, |given| Ok(given.to_radians()), |value, _all| Some(degrees(*value)), |value| Some(value.to_degrees())
}
form! {
    /// Thousandths of a radian in the file, radians here.
    Milliradians: f64 => f64, |given| Ok(given / 1e3),
    |value, _all| Some(nice(value * 1e3, *value, |v| v / 1e3)), |value| Some(value * 1e3)
}
form! {
    /// Yes or no.
    Switch: bool => bool, Ok, |value, _all| Some(value.to_string()), |_| None
}
form! {
    /// Yes, or left out.
    AskedSwitch: bool => bool, Ok, |value, _all| value.then(|| "true".to_string()), |_| None
}
form! {
    /// Points of a curve by flow.
    Points: Vec<[f32; 2]> => CurvePoints, |given| {
        CurvePoints::from_slice(&given).map_err(|_| {
            refusal!("extruder: a curve has {CURVE_POINTS_MAX} points at most, {} are given", given.len())
        })
    }, |points, _all| (!points.is_empty()).then(|| {
        let points: Vec<String> = points.iter().map(|[flow, value]| format!("[{flow}, {value}]")).collect();
        format!("[{}]", points.join(", "))
    }), |_| None
}
form! {
    /// Least and greatest share of the planned flow, as far as the board goes.
    FlowRange: [f64; 2] => [f64; 2], |given| {
        let can_be = (0.1..=1.0).contains(&given[0]) && (1.0..=2.0).contains(&given[1]);
        can_be.then_some(given).ok_or_else(|| {
            refusal!("measure.flow_range: the least share of the planned flow, 0.1 to 1, then the greatest, 1 to 2")
        })
    }, |value, _all| Some(format!("[{}]", value.map(number).join(", "))), |_| None
}
form! {
    /// A text.
    Words: String => String, Ok, |value, _all| Some(quoted(value)), |_| None
}
form! {
    /// The nozzle's aperture in words.
    ApertureWords: String => Aperture, |given| {
        parse_aperture(&given).map_err(|refused| refusal!("print.aperture: {refused}"))
    }, |value, _all| Some(quoted(&aperture_text(value))), |_| None
}

/// One of a few by name.
pub(super) struct Named<T>(PhantomData<T>);

impl<T: super::choices::Choice> Form for Named<T> {
    type Given = Option<T>;
    type Setting = T;
    fn read(given: Option<T>) -> Result<Option<T>, Refusal> {
        Ok(given)
    }
    fn written(setting: &T, _: bool) -> Option<String> {
        Some(quoted(setting.choice_name()))
    }
}

/// A key that must be there.
pub(super) struct Required<F>(PhantomData<F>);

impl<V: DeserializeOwned + Clone, F: Form<Given = Option<V>>> Form for Required<F> {
    type Given = V;
    type Setting = F::Setting;
    fn read(given: V) -> Result<Option<F::Setting>, Refusal> {
        F::read(Some(given))
    }
    fn written(setting: &F::Setting, all: bool) -> Option<String> {
        F::written(setting, all)
    }
    fn number(setting: &F::Setting) -> Option<f64> {
        F::number(setting)
    }
}

/// What a number may be.
pub(super) enum Range {
    /// Anything here: what it must be depends on other settings.
    Any,
    /// From one to the other.
    Within(f64, f64),
    /// The same of what cannot be 0.
    Above0([f64; 2]),
}

impl Range {
    pub(super) fn check(&self, key: &str, value: Option<f64>) -> Result<(), Refusal> {
        match (self, value) {
            (Range::Any, _) | (_, None) => Ok(()),
            (Range::Within(low, high), Some(value)) => in_range(key, value, *low, *high),
            (Range::Above0(range), Some(value)) => sensible(key, value, *range),
        }
    }
}

/// Declares a group: the comment above it, its struct, what it sets, its name; then each key with its comment, form, place
/// and range, and when it is written if not always.
macro_rules! keys {
    ($(#[doc = $above:literal])* $name:ident of $root:ty, $group:literal {
        $($(#[doc = $comment:literal])* $key:ident: $form:ty = $($place:ident)|+ $([$index:literal])?, $range:expr
            $(, when $when:expr)?;)+
    }) => {
        #[derive(Clone, Default, serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        pub(super) struct $name {
            $(pub(super) $key: <$form as Form>::Given,)+
        }

        impl $name {
            /// Sets what is given.
            pub(super) fn set(&self, settings: &mut $root) -> Result<(), Refusal> {
                $(if let Some(value) = <$form as Form>::read(self.$key.clone())? {
                    settings.$($place).+ $([$index])? = value;
                })+
                Ok(())
            }

            /// Writes the keys alone.
            pub(super) fn write_keys(text: &mut String, settings: &$root, all: bool) {
                $(
                    let value = <$form as Form>::written(&settings.$($place).+ $([$index])?, all);
                    $(
                        let is_shown: fn(&$root) -> bool = $when;
                        let value = value.filter(|_| is_shown(settings));
                    )?
                    if let Some(value) = value {
                        $(text.push_str(concat!("#", $comment, "\n"));)*
                        text.push_str(&format!("{} = {value}\n", stringify!($key)));
                    }
                )+
            }

            /// Writes the group.
            pub(super) fn write(text: &mut String, settings: &$root, all: bool) {
                text.push_str(concat!("\n", $("#", $above, "\n",)* "[", $group, "]\n"));
                Self::write_keys(text, settings, all);
            }

            /// Checks each key's range.
            pub(super) fn check(settings: &$root) -> Result<(), Refusal> {
                $(
                    let number = <$form as Form>::number(&settings.$($place).+ $([$index])?);
                    $range.check(concat!($group, ".", stringify!($key)), number)?;
                )+
                Ok(())
            }
        }
    };
}
pub(super) use keys;

/// Shortest decimal that reads back as the same number.
pub(super) fn number(value: f64) -> String {
    format!("{value}")
}

/// Degrees of an angle, as [`nice`] writes them.
pub(super) fn degrees(rad: f64) -> String {
    nice(rad.to_degrees(), rad, f64::to_radians)
}

/// The shortest decimal near `value` that `back` turns into exactly `wanted`: 1080 rather than
/// 1080.0000000000002. Neighbouring floats are tried where rounding never hits.
pub(super) fn nice(value: f64, wanted: f64, back: impl Fn(f64) -> f64) -> String {
    for digits in 0..=15usize {
        let text = format!("{value:.digits$}");
        if text.parse().is_ok_and(|v: f64| back(v) == wanted) {
            return text;
        }
    }
    let (mut low, mut high) = (value, value);
    for _ in 0..8 {
        for near in [low, high] {
            if back(near) == wanted {
                return number(near);
            }
        }
        (low, high) = (low.next_down(), high.next_up());
    }
    number(value)
}

/// A point or a direction.
pub(super) fn triple(values: [f64; 3]) -> String {
    format!("[{}]", values.map(number).join(", "))
}

/// A TOML basic string.
pub(super) fn quoted(text: &str) -> String {
    toml::Value::String(text.to_string()).to_string()
}
