//! Data of a job's passes in addition to their motion: the kind of bead, the line of the file that it follows.
//!
//! In: a plan's curves, the kinds of a part's passes, the passes of a slicer's file, or the text that a job file has of
//! them. Out: a closure that says both of every point of the path, in order, and that text.

use crate::gcode::{BeadKind, GcodePass, Leg};
use crate::job::file::JobHeader;
use crate::job::{Mark, MotionState};
use crate::pipeline::layer_uses::{PassUse, Use};
use crate::report::job_texts::{LATER_KINDS_TEXT, PASS_KINDS_TEXT};
use crate::report::layer_path::{PathPoint, What};
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// How much farther along a file's pass a point may be than it is from the point before, mm: what corners are rounded
/// by. A loop that is closed ends where it begins; the end is not considered too early.
const AHEAD_MM: f64 = 0.5;
/// Kinds of passes as a job file has them, and in PrusaSlicer's words.
const LETTERS: [(char, What, &str); 6] = [
    ('w', What::Wall, "Perimeter"),
    ('f', What::Solid, "Solid infill"),
    ('s', What::Sparse, "Internal infill"),
    ('b', What::Bridge, "Bridge infill"),
    ('k', What::Skirt, "Skirt/Brim"),
    ('u', What::Support, "Support material"),
];
const UNKNOWN_LETTER: char = '-';

/// How far a file's pass was followed.
#[derive(Clone, Copy, Debug)]
struct Followed {
    pass: usize,
    leg: usize,
    /// Along that leg.
    along_mm: f64,
    tip_mm: Vector3<f64>,
}

/// Of a job.
#[derive(Clone, Debug, Default)]
pub enum PassFacts {
    /// Nothing: the job came from a file without them.
    #[default]
    Unknown,
    /// By the number of the pass, and what is something else by number and servo ticks from its start on.
    Kinds(Vec<What>, LaterKinds),
    /// Of a slicer's file.
    File(FilePasses),
}

/// By the number of a pass and servo ticks after its start: what it is from there on.
pub type LaterKinds = BTreeMap<(u32, u64), What>;

/// Passes of a file, and the one that each pass of the job follows.
#[derive(Clone, Debug)]
pub struct FilePasses {
    /// The file's.
    pub passes: Vec<GcodePass>,
    /// For each of the job's the number of the file's.
    pub of_job: Vec<usize>,
}

impl PassFacts {
    /// What lines are numbered by.
    pub fn line_name(&self) -> &'static str {
        match self {
            PassFacts::File(_) => "Line of the file",
            PassFacts::Unknown | PassFacts::Kinds(..) => "Segment",
        }
    }

    /// Of a plan's passes in their order.
    pub fn of_uses(uses: &[PassUse]) -> PassFacts {
        let what = |used: &Use| match used {
            Use::Walls => What::Wall,
            Use::Solid => What::Solid,
            Use::Sparse => What::Sparse,
            Use::Bridge => What::Bridge,
            Use::Skirt => What::Skirt,
            Use::Travel | Use::Standing => What::Bead,
        };
        let later = (0..).zip(uses).flat_map(|(number, of_pass)| {
            let then = of_pass.then.iter();
            then.map(move |(ticks, used)| ((number, *ticks), what(used)))
        });
        let later = later.collect();
        PassFacts::Kinds(uses.iter().map(|of| what(&of.first)).collect(), later)
    }

    /// What a job file has of passes that change their kind: number, servo ticks from its start and letter of each change.
    pub fn later_text(&self) -> Option<String> {
        let PassFacts::Kinds(_, later) = self else {
            return None;
        };
        let rows = later.iter();
        let rows: Vec<_> = rows
            .map(|((pass, ticks), what)| (pass, ticks, letter_of(*what)))
            .collect();
        let text = serde_json::to_string(&rows).ok();
        text.filter(|_| !rows.is_empty())
    }

    /// What a job file has of them: a letter for each pass. `None` where nothing is known.
    pub fn text(&self) -> Option<String> {
        let text: String = self.first_kinds().into_iter().map(letter_of).collect();
        let is_known = text.contains(|letter| letter != UNKNOWN_LETTER);
        is_known.then_some(text)
    }

    /// What each pass is at its start, of a slicer's file in its first line.
    fn first_kinds(&self) -> Vec<What> {
        match self {
            PassFacts::Unknown => Vec::new(),
            PassFacts::Kinds(kinds, _) => kinds.clone(),
            PassFacts::File(file) => {
                let passes = file.of_job.iter().map(|&number| file.passes.get(number));
                let first = passes.map(|pass| pass.and_then(|pass| pass.legs.first()));
                first.map(|leg| leg.map_or(What::Bead, what)).collect()
            }
        }
    }

    /// What a job's header has of them.
    pub fn of_job(header: &JobHeader) -> PassFacts {
        let text = |key: &str| header.texts.get(key).map(String::as_str);
        text(PASS_KINDS_TEXT).map_or(PassFacts::Unknown, |kinds| {
            PassFacts::of_texts(kinds, text(LATER_KINDS_TEXT))
        })
    }

    /// What [`PassFacts::text`] and [`PassFacts::later_text`] wrote; another letter is a bead of which no more is known.
    fn of_texts(text: &str, later: Option<&str>) -> PassFacts {
        let what = |letter: char| {
            let known = LETTERS.iter().find(|(of, ..)| *of == letter);
            known.map_or(What::Bead, |(_, what, _)| *what)
        };
        let rows = later.and_then(|later| serde_json::from_str(later).ok());
        let rows: Vec<(u32, u64, char)> = rows.unwrap_or_default();
        let later = rows
            .iter()
            .map(|(pass, ticks, letter)| ((*pass, *ticks), what(*letter)));
        PassFacts::Kinds(text.chars().map(what).collect(), later.collect())
    }

    /// Kinds in a slicer's words, each from a servo tick on; on each layer anew. Of a file's passes those of their first lines.
    pub fn slicer_words(&self, marks: &[Mark]) -> Vec<(u64, &'static str)> {
        let none = LaterKinds::new();
        let later = match self {
            PassFacts::Kinds(_, later) => later,
            PassFacts::Unknown | PassFacts::File(_) => &none,
        };
        let kinds = self.first_kinds();
        let mut words = Vec::new();
        let mut before = None;
        for mark in marks.iter().filter(|mark| mark.state == MotionState::Print) {
            let Some(pass) = mark.pass else {
                continue;
            };
            let first = kinds.get(pass as usize).map(|what| (0, *what));
            let then = later.range((pass, 0)..=(pass, u64::MAX));
            let then = then.map(|((_, ticks), what)| (*ticks, *what));
            for (ticks, what) in first.into_iter().chain(then) {
                let word = LETTERS.iter().find(|(_, of, _)| *of == what);
                if let (Some((.., word)), true) = (word, before != Some((mark.layer, what))) {
                    words.push((mark.start_tick + ticks, *word));
                }
                before = Some((mark.layer, what));
            }
        }
        words
    }

    /// What the head does from a point on, and its line.
    pub fn follow(&self) -> impl FnMut(&Mark, &PathPoint) -> (What, u32) + '_ {
        let mut at = None;
        move |mark, point| match self {
            PassFacts::File(file) => file.at(mark, point, &mut at),
            _ => (
                What::of(mark.state, self.bead(mark, point.tick)),
                point.segment as u32 + 1,
            ),
        }
    }

    fn bead(&self, mark: &Mark, tick: u64) -> What {
        let (PassFacts::Kinds(kinds, later), Some(pass)) = (self, mark.pass) else {
            return What::Bead;
        };
        let begun = later.range((pass, 0)..=(pass, tick.saturating_sub(mark.start_tick)));
        let kind = begun
            .last()
            .map(|(_, what)| what)
            .or_else(|| kinds.get(pass as usize));
        kind.copied().unwrap_or(What::Bead)
    }
}

impl FilePasses {
    /// The leg of a point.
    fn at(&self, mark: &Mark, point: &PathPoint, at: &mut Option<Followed>) -> (What, u32) {
        let number = mark.pass.and_then(|pass| self.of_job.get(pass as usize));
        let pass = number.and_then(|&number| Some((number, self.passes.get(number)?)));
        let Some((number, pass)) = pass.filter(|_| mark.state == MotionState::Print) else {
            // Before the next pass: the line that goes there.
            let next = at.map_or(0, |at| at.pass + 1);
            let leg = self
                .passes
                .get(next)
                .and_then(|pass| pass.travel_legs.last());
            let line = leg.map_or(0, |leg| leg.line as u32);
            return (What::of(mark.state, What::Bead), line);
        };
        let tip_mm = Vector3::from(point.tip_mm);
        let before = at.filter(|at| at.pass == number).unwrap_or(Followed {
            pass: number,
            leg: 0,
            along_mm: 0.0,
            tip_mm,
        });
        let now = followed(pass, before, tip_mm);
        *at = Some(now);
        let leg = pass.legs.get(now.leg);
        leg.map_or((What::Bead, 0), |leg| (what(leg), leg.line as u32))
    }
}

/// The nearest place of a pass that is not much farther along it than the tip has moved.
fn followed(pass: &GcodePass, before: Followed, tip_mm: Vector3<f64>) -> Followed {
    let mut room_mm = (tip_mm - before.tip_mm).norm() + AHEAD_MM + before.along_mm;
    let mut nearest = (f64::INFINITY, before);
    for (leg, ends) in pass.points.windows(2).enumerate().skip(before.leg) {
        if room_mm <= 0.0 {
            break;
        }
        let [from, to] = [0, 1].map(|k| Vector3::from(ends[k].tip_mm));
        let way = to - from;
        let long_mm = way.norm();
        let along_mm = (tip_mm - from).dot(&way) / long_mm.max(1e-9);
        let along_mm = along_mm.clamp(0.0, long_mm.min(room_mm));
        let off_mm = (tip_mm - from - way * (along_mm / long_mm.max(1e-9))).norm();
        if off_mm < nearest.0 {
            let place = Followed {
                leg,
                along_mm,
                tip_mm,
                ..before
            };
            nearest = (off_mm, place);
        }
        room_mm -= long_mm;
    }
    Followed {
        tip_mm,
        ..nearest.1
    }
}

fn letter_of(what: What) -> char {
    let known = LETTERS.iter().find(|(_, of, _)| *of == what);
    known.map_or(UNKNOWN_LETTER, |(letter, ..)| *letter)
}

fn what(leg: &Leg) -> What {
    match leg.kind {
        BeadKind::OuterWall | BeadKind::FuzzyWall | BeadKind::Wall | BeadKind::Overhang => {
            What::Wall
        }
        BeadKind::Solid | BeadKind::Ironing => What::Solid,
        BeadKind::Sparse => What::Sparse,
        BeadKind::Bridge => What::Bridge,
        BeadKind::Skirt => What::Skirt,
        BeadKind::Support => What::Support,
        BeadKind::Unknown => What::Bead,
    }
}

#[cfg(test)]
mod tests {
    use super::{Mark, MotionState, PassFacts, What};
    use crate::pipeline::layer_uses::{PassUse, Use};

    /// Goal: a job file says of its passes what the plan knew, and unknown letters are no more than beads. Method: one of each
    /// kind there and back.
    #[test]
    fn kinds_come_back() {
        let uses = [Use::Walls, Use::Solid, Use::Sparse, Use::Bridge, Use::Skirt];
        let mut uses = uses.map(|first| PassUse {
            first,
            then: Vec::new(),
        });
        uses[0].then = vec![(30, Use::Solid), (70, Use::Bridge)];
        let facts = PassFacts::of_uses(&uses);
        let text = facts.text().expect("kinds");
        assert_eq!(text, "wfsbk");
        let then = facts.later_text().expect("later kinds");
        assert_eq!(then, r#"[[0,30,"f"],[0,70,"b"]]"#);
        let facts = PassFacts::of_texts(&format!("{text}u?-"), Some(&then));
        let mark = Mark {
            start_tick: 100,
            end_tick: 200,
            state: MotionState::Print,
            layer: 0,
            pass: Some(0),
        };
        let at = |tick: u64| facts.bead(&mark, tick);
        assert_eq!(
            [at(129), at(130), at(171)],
            [What::Wall, What::Solid, What::Bridge]
        );
        let PassFacts::Kinds(kinds, _) = &facts else {
            panic!("kinds");
        };
        let [wall, solid, sparse, bridge, skirt, support, other, unknown] = kinds[..] else {
            panic!("one a letter: {kinds:?}");
        };
        assert_eq!(
            [wall, solid, sparse],
            [What::Wall, What::Solid, What::Sparse]
        );
        assert_eq!(
            [bridge, skirt, support],
            [What::Bridge, What::Skirt, What::Support]
        );
        assert_eq!([other, unknown], [What::Bead; 2]);
        assert_eq!(PassFacts::Unknown.text(), None);
        assert_eq!(PassFacts::of_texts("--", None).text(), None);
    }
}
