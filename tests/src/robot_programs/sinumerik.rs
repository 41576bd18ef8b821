//! Programs of a Sinumerik 840D sl gantry with the axes X, Y, Z and C about Z.
//!
//! In: main programs (`.MPF`) and subprograms (`.SPF`). Out: [`Step`]s, mm, degrees and seconds. Source: Siemens, "NC
//! programming", programming manual 12/2019 (6FC5398-2EP40-0BA0); "SINUMERIK 840D/840Di/810D Fundamentals", 11/2006
//! (6FC5398-1BP10-2BA0); "Job planning" 07/2010 (6FC5398-2BP40-0BA0), EXTCALL. Not covered, and refused: G0, G91, other
//! frames than G54 to G57, splines, circles, spindles, M functions but M17 and M30, variables, jumps, calls by name. A
//! blend by G642 is taken as far as the tolerance.

mod state;

use super::tokens::split_comment;
use super::{ProgramError, SourceFile, Step};
use state::{State, Word, axis_of, words};

const LEVELS_MAX: usize = 16;
/// Characters that the name of a program may have.
const NAME_LENGTH_MAX: usize = 24;
/// Characters that a block may have, its comment and the end of its line included.
const BLOCK_LENGTH_MAX: usize = 512;

/// Runs the main program in the file `main`.
///
/// The rotation of a target is about Z by C, and `external` is C in degrees, counted over the turns. The frame is the
/// last of G54 to G57 (`G500` before), the tool D0 once it is selected. A block's speed is what F and FGROUP make of
/// it. Synchronised actions, and comments that begin with `layer`, are notes.
pub fn run_sinumerik(files: &[SourceFile], main: &str) -> Result<Vec<Step>, ProgramError> {
    let file = files.iter().find(|file| file.name == main);
    let file = file.filter(|_| main.to_ascii_uppercase().ends_with(".MPF"));
    let file =
        file.ok_or_else(|| ProgramError::new(main, 0, "there is no such main program (.MPF)"))?;
    let mut run = Run {
        files,
        state: State::default(),
        steps: Vec::new(),
    };
    run.program(file, 1)?;
    Ok(run.steps)
}

struct Run<'a> {
    files: &'a [SourceFile],
    state: State,
    steps: Vec<Step>,
}

enum Next<'a> {
    Block,
    End,
    Subprogram(&'a SourceFile),
}

#[derive(Default)]
struct Block {
    groups: Vec<u8>,
    axes: Vec<(usize, f64)>,
    has_feed: bool,
    is_exact_stop: bool,
    outputs: Vec<(String, f64)>,
    is_end: bool,
}

impl<'a> Run<'a> {
    fn program(&mut self, file: &'a SourceFile, level: usize) -> Result<(), ProgramError> {
        let fail = |line, problem| ProgramError::new(&file.name, line, problem);
        for (index, text) in file.text.lines().enumerate() {
            let line = index + 1;
            let next = self.line(text, (&file.name, line));
            match next.map_err(|problem| fail(line, problem))? {
                Next::Block => {}
                Next::End => return Ok(()),
                Next::Subprogram(_) if level == LEVELS_MAX => {
                    return Err(fail(line, format!("more than {LEVELS_MAX} program levels")));
                }
                Next::Subprogram(called) => self.program(called, level + 1)?,
            }
        }
        let problem = "the program has no end (M17 or M30)".to_owned();
        Err(fail(file.text.lines().count(), problem))
    }

    fn line(&mut self, text: &str, place: (&str, usize)) -> Result<Next<'a>, String> {
        if text.chars().count() + 1 > BLOCK_LENGTH_MAX {
            return Err(format!("more than {BLOCK_LENGTH_MAX} characters"));
        }
        let (code, comment) = split_comment(text, ';');
        let (code, comment) = (without_number(code.trim()), comment.unwrap_or_default());
        let start = comment.get(..5).unwrap_or_default();
        if start.eq_ignore_ascii_case("layer") {
            let text = comment.to_owned();
            self.steps.push(Step::Note { text });
        }
        let capitals = code.to_ascii_uppercase();
        if capitals.starts_with("WHEN ")
            || capitals.starts_with("ID=")
            || capitals.starts_with("IDS=")
        {
            if !capitals.contains(" DO ") {
                return Err("a synchronised action without DO".to_owned());
            }
            let text = code.to_owned();
            self.steps.push(Step::Note { text });
            return Ok(Next::Block);
        }
        let words = words(code)?;
        if let Some(next) = self.lone_words(&words)? {
            return Ok(next);
        }
        let mut block = Block::default();
        for word in &words {
            self.word(word, &mut block)?;
        }
        self.finish(block, place)
    }

    /// What must be in a block of its own: calls and dwell times.
    fn lone_words(&mut self, words: &[Word]) -> Result<Option<Next<'a>>, String> {
        let path = match words {
            [call] if call.name == "EXTCALL" => {
                let quoted = call.arguments.as_deref().unwrap_or_default();
                let path = quoted.strip_prefix('"').unwrap_or_default();
                path.strip_suffix('"').ok_or("EXTCALL has no program")?
            }
            [call, text] if call.name == "EXTCALL" && text.name == "\"" => {
                text.arguments.as_deref().unwrap_or_default()
            }
            [g, f] if (&*g.name, &*f.name) == ("G", "F") && ["4", "04"].contains(&&*g.number) => {
                let seconds = f.value.filter(|&seconds| seconds >= 0.0);
                let seconds = seconds.ok_or("a negative time")?;
                self.steps.push(Step::Wait { seconds });
                return Ok(Some(Next::Block));
            }
            _ => return Ok(None),
        };
        Ok(Some(Next::Subprogram(self.subprogram(path)?)))
    }

    /// File of a subprogram, by its name with or without a path and an ending.
    fn subprogram(&self, path: &str) -> Result<&'a SourceFile, String> {
        let name = path.rsplit('/').next().unwrap_or(path).to_ascii_uppercase();
        let cut = name
            .len()
            .checked_sub(4)
            .and_then(|at| name.split_at_checked(at));
        let cut = cut.filter(|cut| ["_SPF", ".SPF", "_MPF", ".MPF"].contains(&cut.1));
        let (stem, ending) = cut.unwrap_or((&name, ""));
        let start = stem.get(..2).unwrap_or_default().trim_start_matches('_');
        let has_start = !start.is_empty() && start.bytes().all(|byte| byte.is_ascii_alphabetic());
        if stem.len() > NAME_LENGTH_MAX || !has_start {
            return Err(format!("{stem} cannot be the name of a called program"));
        }
        // A name without an ending is first looked for among the subprograms.
        let wanted = ["SPF", "MPF"]
            .into_iter()
            .filter(|other| ending.is_empty() || ending.ends_with(other));
        let found = wanted
            .map(|ending| format!("{stem}.{ending}"))
            .find_map(|name| {
                let mut files = self.files.iter();
                files.find(|file| file.name.eq_ignore_ascii_case(&name))
            });
        found.ok_or_else(|| format!("there is no program {path}"))
    }

    fn word(&mut self, word: &Word, block: &mut Block) -> Result<(), String> {
        let name = word.name.as_str();
        let (index, arguments) = (word.index.as_deref(), word.arguments.as_deref());
        match (name, index, arguments, word.value) {
            ("G", None, None, Some(_)) if ["9", "09"].contains(&&*word.number) => {
                block.is_exact_stop = true;
            }
            ("G", None, None, Some(_)) => {
                let group = self.state.g_command(&word.number)?;
                if block.groups.contains(&group) {
                    return Err(format!("the block has two G commands of group {group}"));
                }
                block.groups.push(group);
            }
            ("M", None, None, Some(_)) if ["17", "30"].contains(&&*word.number) => {
                block.is_end = true;
            }
            ("D", None, None, Some(_)) if word.number == "0" => self.state.tool = "D0".to_owned(),
            ("F", None, None, Some(f)) => {
                if std::mem::replace(&mut block.has_feed, true) {
                    return Err("a block can have one F".to_owned());
                }
                if f <= 0.0 {
                    return Err("the feed is not positive".to_owned());
                }
                self.state.feed = Some(f);
            }
            ("FGROUP", None, Some(axes), None) => self.state.set_group(axes)?,
            ("CTOL" | "OTOL" | "ATOL", axis, None, Some(value)) => {
                self.state.set_tolerance(name, axis, value)?;
            }
            ("$A_OUT" | "$A_OUTA", Some(number), None, Some(value)) => {
                if !number.parse().is_ok_and(|number: u32| number > 0) {
                    return Err(format!("there is no {name}[{number}]"));
                }
                if name == "$A_OUT" && value != 0.0 && value != 1.0 {
                    return Err("a digital output is 0 or 1".to_owned());
                }
                block.outputs.push((format!("{name}[{number}]"), value));
            }
            ("X" | "Y" | "Z" | "C", None, None, Some(value)) => {
                let axis = axis_of(name)?;
                if block.axes.iter().any(|&(earlier, _)| earlier == axis) {
                    return Err(format!("the block has {name} twice"));
                }
                block.axes.push((axis, value));
            }
            ("SOFT", None, None, None) => {}
            _ => return Err(format!("the word {name} is not covered here")),
        }
        Ok(())
    }

    fn finish(&mut self, block: Block, (file, line): (&str, usize)) -> Result<Next<'a>, String> {
        if !block.axes.is_empty() && !block.outputs.is_empty() {
            return Err("an output in a block with a motion is not covered here".to_owned());
        }
        for (name, value) in block.outputs {
            self.steps.push(Step::output(file, line, name, value));
        }
        if !block.axes.is_empty() {
            let motion = self
                .state
                .motion(&block.axes, block.is_exact_stop, (file, line))?;
            self.steps.extend(motion.map(Step::Move));
        }
        Ok(if block.is_end { Next::End } else { Next::Block })
    }
}

fn without_number(code: &str) -> &str {
    match code.strip_prefix(['N', 'n']) {
        Some(rest) if rest.starts_with(|c: char| c.is_ascii_digit()) => rest
            .trim_start_matches(|c: char| c.is_ascii_digit())
            .trim_start(),
        _ => code,
    }
}

#[cfg(test)]
mod tests {
    use super::super::shown;
    use super::*;

    fn run(text: &str) -> Result<Vec<Step>, ProgramError> {
        let file = |name: &str, text: &str| {
            let (name, text) = (name.to_owned(), text.to_owned());
            SourceFile { name, text }
        };
        let sub = file("LAYER_1.SPF", "; Layer 1\nX20 C90\nM17");
        let endless = file("ENDLESS.SPF", "EXTCALL \"ENDLESS\"\nM17");
        let files = [file("A.MPF", text), sub, endless];
        run_sinumerik(&files, "A.MPF")
    }

    /// Goal: axes outside FGROUP follow those in it; the other blocks are read. Method: the example of function manual
    /// 08/2005 (6FC5397-0BP10-0BA0), K2, 2.1.10, with a start by G1; it prints 707 mm/min for X and Y, then 1000 mm/min
    /// for X and 500 mm/min for Y (18.63 mm/s together). Of its example of FGROUP(X,C) (Fundamentals 11/2006, 7.1): 10
    /// mm and 10 degrees at 100 mm/min, that is 14.14 mm in 8 s. Then one block of each kind.
    #[test]
    fn examples_of_the_manual() {
        let text = "N05 G1 G94 G90 F1000 X0 Y0 Z0 ;\nN10 FGROUP(X,Y) ; Axes X/Y are path axes\nN20 G01 X100 Y100\n\
             N30 FGROUP (X) ; Axis X is a path axis\nN20 X200 Y150\nFGROUP(X,C)\nX210 C10 F 100\nC20\n\
             FGROUP()\nG71 G54 D0 SOFT G642 CTOL=0.1 OTOL=1 X6Y-.5\nATOL[Y]=0.05 X7\nG9 X8\nEXTCALL \"parts/Layer_1.SPF\"\n\
             EXTCALL(\"LAYER_1\")\nG60 X9\n$A_OUTA[1]=2.5 $A_OUT[9] = 1\nG4 F0.5\n\
             N9 ID=1 WHENEVER $A_IN[1]==1 DO $A_OUT[2]=1\nWHEN $AA_IW[X]>10 DO $A_OUTA[1]=0\nM30\nunread";
        let expected = "\
             A.MPF:1 Line [16.67, inf, 1.00, 0.00] (\"\", \"G500\", None) [0.0, 0.0, 0.0] [[1.0, 0.0, 0.0], [0.0, \
             0.0, 1.0]] [0.0] None\n\
             A.MPF:3 Line [16.67, inf, 1.00, 0.00] (\"\", \"G500\", None) [100.0, 100.0, 0.0] [[1.0, 0.0, 0.0], [0.0, \
             0.0, 1.0]] [0.0] \
             None\n\
             A.MPF:5 Line [18.63, inf, 1.00, 0.00] (\"\", \"G500\", None) [200.0, 150.0, 0.0] [[1.0, 0.0, 0.0], [0.0, \
             0.0, 1.0]] [0.0] \
             None\n\
             A.MPF:7 Line [1.18, 1.18, 1.00, 0.00] (\"\", \"G500\", None) [210.0, 150.0, 0.0] [[1.0, 0.2, 0.0], [0.0, \
             0.0, 1.0]] [10.0] \
             None\n\
             A.MPF:8 Line [inf, 1.67, 1.00, 0.00] (\"\", \"G500\", None) [210.0, 150.0, 0.0] [[0.9, 0.3, 0.0], [0.0, \
             0.0, 1.0]] [20.0] \
             None\n\
             A.MPF:10 Line [1.67, inf, 1.00, 0.10] (\"D0\", \"G54\", None) [6.0, -0.5, 0.0] [[0.9, 0.3, 0.0], [0.0, \
             0.0, 1.0]] [20.0] \
             None\n\
             A.MPF:11 Line [1.67, inf, 1.00, 0.05] (\"D0\", \"G54\", None) [7.0, -0.5, 0.0] [[0.9, 0.3, 0.0], [0.0, \
             0.0, 1.0]] [20.0] \
             None\n\
             A.MPF:12 Line [1.67, inf, 1.00, 0.00] (\"D0\", \"G54\", None) [8.0, -0.5, 0.0] [[0.9, 0.3, 0.0], [0.0, \
             0.0, 1.0]] [20.0] \
             None\n\
             Note { text: \"Layer 1\" }\n\
             LAYER_1.SPF:2 Line [1.67, inf, 1.00, 0.05] (\"D0\", \"G54\", None) [20.0, -0.5, 0.0] [[0.0, 1.0, 0.0], \
             [0.0, 0.0, 1.0]] [90.0] \
             None\n\
             Note { text: \"Layer 1\" }\n\
             LAYER_1.SPF:2 Line [1.67, inf, 1.00, 0.05] (\"D0\", \"G54\", None) [20.0, -0.5, 0.0] [[0.0, 1.0, 0.0], \
             [0.0, 0.0, 1.0]] [90.0] \
             None\n\
             A.MPF:15 Line [1.67, inf, 1.00, 0.00] (\"D0\", \"G54\", None) [9.0, -0.5, 0.0] [[0.0, 1.0, 0.0], [0.0, \
             0.0, 1.0]] [90.0] \
             None\n\
             Output { file: \"A.MPF\", line: 16, name: \"$A_OUTA[1]\", value: 2.50, before_end_mm: 0.00, delay_s: 0.00 }\n\
             Output { file: \"A.MPF\", line: 16, name: \"$A_OUT[9]\", value: 1.00, before_end_mm: 0.00, delay_s: 0.00 }\n\
             Wait { seconds: 0.50 }\n\
             Note { text: \"ID=1 WHENEVER $A_IN[1]==1 DO $A_OUT[2]=1\" }\n\
             Note { text: \"WHEN $AA_IW[X]>10 DO $A_OUTA[1]=0\" }\n";
        assert_eq!(shown(&run(text).expect("a program")), expected);
    }

    /// Goal: what is not allowed or not covered is refused with its line. Method: one such block each, after the start
    /// of a program; a program without an end, one without a known start, one without end of its calls.
    #[test]
    fn refusals() {
        for block in
            "G0 X1|G91|G93|G55 G56|G64|G2 X1 Y1|M3|M2|T1|D1|X1 X2|X=IC(1)|F100 F200|F0|A10|X1=10|\
             LAYER_1|BSPLINE|G642 X1|$A_OUT[1]=2|$A_OUT[1]=1 X1|X=R7|R1=2|G4 S3|G4 F-1|\
             EXTCALL \"9PART\"|EXTCALL \"NONE\"|WHEN $AA_IW[X]>10|/X10|FL[C]=10|TRANS X10"
                .split('|')
        {
            let error = run(&format!("F600 X0 Y0 Z0\n{block}\nM30")).expect_err(block);
            assert_eq!(error.line, 2, "{block}: {error}");
        }
        let texts = "F600 X0 Y0 Z0|X0 Y0 Z0\nM30|EXTCALL \"ENDLESS\"";
        for text in texts.split('|') {
            assert_eq!(run(text).expect_err(text).line, 1);
        }
    }
}
