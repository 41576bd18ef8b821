//! Paths of the tip: waypoints and NURBS curves.

use super::Want::{Path, Refused};
use super::{Case, Kind, Want, case};
use headway::input::Format;

pub fn cases() -> Vec<Case> {
    let points =
        |what, text: &str, want: Want| case(what, Kind::Drawing(Format::Waypoints), text, want);
    let curve = |what, text: &str, want: Want| case(what, Kind::Drawing(Format::Nurbs), text, want);
    let line =
        r#"{"degree":1,"control_points":[[0,0,1],[3,4,1]],"weights":[1,1],"knots":[0,0,1,1]}"#;
    vec![
        points("two points", "0 0 1 0 0 1\n3 4 1 0 0 1\n", Path(5.0)),
        points(
            "commas, CR LF and a comment",
            "# x,y,z,nx,ny,nz\r\n0,0,1,0,0,1\r\n3,4,1,0,0,1\r\n",
            Path(5.0),
        ),
        points(
            "a line of two numbers",
            "0 0 1 0 0 1\n3 4\n",
            Refused("line 2"),
        ),
        points(
            "a number that is none",
            "0 0 1 0 0 1\n3 x 1 0 0 1\n",
            Refused("line 2"),
        ),
        points(
            "a number beyond all",
            "0 0 1 0 0 1\n1e999 0 1 0 0 1\n",
            Refused("line 2"),
        ),
        points(
            "an axis of no length",
            "0 0 1 0 0 0\n3 4 1 0 0 1\n",
            Refused("line 1"),
        ),
        points("one point", "0 0 1 0 0 1\n", Refused("2 or more")),
        curve("a straight curve", line, Path(5.0)),
        curve(
            "a degree beyond all",
            &line.replace("\"degree\":1", "\"degree\":4000000000"),
            Refused("degree 4000000000"),
        ),
        curve(
            "knots that go back",
            &line.replace("[0,0,1,1]", "[1,1,0,0]"),
            Refused("knots must rise"),
        ),
        curve(
            "a weight of nothing",
            &line.replace("[1,1],\"k", "[1,0],\"k"),
            Refused("weight above 0"),
        ),
    ]
}
