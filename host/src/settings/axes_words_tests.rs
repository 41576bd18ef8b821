//! Goal: every term says what it says, and what could be meant in two ways is asked for. Method: terms one by one.
use super::*;

fn parsed(text: &str) -> AxesWords {
    AxesWords::parse(text).expect("words")
}

#[test]
fn terms_say_side_line_sense_and_zero() {
    let words = parsed(
        "-b = head:y:at=0/0/42:zero=90, C=table:0/1/1, -U=heading:zero=-45,coordinates=pivot,feed=all,\
         shift=1/-2/3,lean=45,extruder=v",
    );
    let [b, c] = words.rotary.as_slice() else {
        panic!("{words:?}");
    };
    assert_eq!((b.name.as_str(), b.on_table), ("B", false));
    assert_eq!(
        (b.axis, b.at_mm),
        ([0.0, -1.0, 0.0], Some([0.0, 0.0, 42.0]))
    );
    assert!((b.zero_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    let half = std::f64::consts::FRAC_1_SQRT_2;
    assert!(c.on_table && c.at_mm.is_none());
    // A direction becomes a unit vector within rounding.
    assert!((c.axis[1] - half).abs() < 1e-12 && (c.axis[2] - half).abs() < 1e-12);
    let heading = words.heading.expect("a heading");
    assert!(heading.name == "U" && heading.negated && heading.zero_rad < -0.78);
    assert_eq!(words.coordinates, Some(Coordinates::Pivot));
    assert_eq!(
        (words.feed, words.extruder),
        (Some(FeedOf::All), Some(b'V'))
    );
    assert_eq!(words.shift_mm, [1.0, -2.0, 3.0]);
    assert!((words.lean_rad.to_degrees() - 45.0).abs() < 1e-12);
    let steppers = parsed("stepper_b=table:x,stepper_a=table:z,coordinates=pivot");
    assert_eq!(steppers.rotary[1].name, "stepper_a");
    let machine = parsed("machine:their file.toml,letters=x/c/z/h");
    assert_eq!(
        machine.machine,
        Some(MachineWord::File("their file.toml".to_string()))
    );
    assert_eq!(machine.letters, Some(b"XCZH".to_vec()));
    assert_eq!(parsed("machine").machine, Some(MachineWord::Own));
    assert!(parsed("C=heading").coordinates.is_none());
}

#[test]
fn what_could_be_meant_in_two_ways_is_asked() {
    let refused = |text: &str| AxesWords::parse(text).expect_err(text).to_string();
    assert!(refused("A=table:x,C=table:z").contains("coordinates=tip or coordinates=pivot"));
    assert!(refused("B=head:y,coordinates=pivot").contains("B=head:...:at=0/0/42"));
    assert!(AxesWords::parse("B=head:y,coordinates=tip").is_ok());
    assert!(
        refused("A=head:x:at=0/0/0,B=head:y:at=0/0/0,C=table:z,coordinates=tip")
            .contains("3 rotary")
    );
    assert!(refused("A=table:x,a=table:y,coordinates=tip").contains("twice"));
    assert!(refused("A=heading,B=heading").contains("twice"));
    assert!(refused("machine:m.toml,A=heading").contains("leave one of them out"));
    assert!(refused("C=heading,letters=X/Y").contains("goes with machine"));
    for wrong in [
        "",
        "A",
        "A=",
        "A=bed:x",
        "A=table",
        "A=table:q",
        "F=table:x",
        "A=table:x:zero",
        "AB C=heading",
        "machine:",
        "coordinates=part",
        "feed=fast",
        "A=heading:at=0/0/1",
        "A=table:0/0/0",
        "A=table:x:at=1/2",
        "lean=x",
        "lean=90",
        "shift=1/2/1e9",
        "A=table:x:zero=400",
        "letters=X/%",
    ] {
        let text = AxesWords::parse(wrong).expect_err(wrong).to_string();
        assert!(text.len() > 20, "{wrong}: {text}");
    }
}
