//! Machine files.

use super::Want::{Refused, Taken};
use super::{Case, Kind, Want, case};
use headway::settings::Settings;
use headway::settings::machine_file::to_toml;

pub fn cases() -> Vec<Case> {
    let plain = to_toml(&Settings::default());
    let of = |what, text: String, want: Want| case(what, Kind::Machine, text, want);
    let with = |key: &str, value: &str| -> String {
        let is_key = |line: &&str| line.split(" =").next() == Some(key);
        let line = plain.lines().find(is_key).expect(key);
        plain.replacen(line, &format!("{key} = {value}"), 1)
    };
    let nested = format!("a = {}", "[".repeat(50_000));
    vec![
        of("the file that Headway writes", plain.clone(), Taken),
        of("CR LF", plain.replace('\n', "\r\n"), Taken),
        of(
            "nothing",
            String::new(),
            Refused("the key `name` is missing"),
        ),
        of(
            "a clock that stands",
            with("servo_hz", "0"),
            Refused("servo_hz"),
        ),
        of(
            "a clock beyond all",
            with("servo_hz", "1e99"),
            Refused("write a whole number"),
        ),
        of(
            "a speed of no number",
            with("speed_max_mm_s", "nan"),
            Refused("joints.x.speed_max is NaN"),
        ),
        of(
            "a text for a number",
            with("servo_hz", "\"fast\""),
            Refused("write a number without quotes"),
        ),
        of(
            "a key that nobody knows",
            "sped = 1\n".to_string() + &plain,
            Refused("unknown key `sped`"),
        ),
        of(
            "a line that is none",
            "machine\n".to_string() + &plain,
            Refused("line 1"),
        ),
        of(
            "fifty thousand brackets",
            nested,
            Refused("max recursion depth"),
        ),
        of(
            "a name of a million letters",
            with("name", &format!("\"{}\"", "n".repeat(1_000_000))),
            Refused("1000000 characters"),
        ),
    ]
}
