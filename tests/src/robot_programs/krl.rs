//! Programs in KRL, the language of KUKA's controllers, run as the manuals say.
//!
//! In: the `.src` and `.dat` files of a program and the name of the one that starts. Out: [`Step`]s in the order of
//! execution. Motions of joints have a share of the greatest speeds and no speed of the tip. A TRIGGER at the start of
//! a motion stands before the motion, one at its end or on its path after it. Values of $ANOUT are shares of the full
//! scale (10 V). A statement that stops the advance run ($OUT, $ANOUT, WAIT) makes the motion before it end exactly.
//! Sources: "KUKA System Software 8.3, Operating and Programming Instructions for System Integrators" and "Expert
//! Programming" (KSS 5.2) as they are quoted in public texts; not held against the manuals' own text. Not covered:
//! program flow, assignments to a program's own variables, interrupts, circles, splines, relative motions, PULSE.

mod motions;
mod sources;

use std::collections::HashMap;

use super::tokens::{Cursor, Token};
use super::{ProgramError, SourceFile, Step};

use motions::{Kept, Settings, Trigger};
use sources::{Numbers, Routine, Source};

/// Routines that call each other this deep are taken for an endless recursion.
const CALLS_DEEP: usize = 100;
/// Numbers of outputs.
const DIGITAL_OUTPUTS: f64 = 4096.0;
const ANALOG_OUTPUTS: f64 = 32.0;

/// Runs the module `main`.
pub fn run_krl(files: &[SourceFile], main: &str) -> Result<Vec<Step>, ProgramError> {
    let (sources, lists) = sources::read(files)?;
    let mut machine = Machine {
        lists,
        settings: Settings::default(),
        kept: Kept::default(),
        moved: false,
        triggers: Vec::new(),
        calls: 0,
        steps: Vec::new(),
    };
    let main = main.to_ascii_uppercase();
    let Some(start) = sources.iter().find(|source| source.module == main) else {
        return Err(ProgramError::new(&main, 1, "there is no such .src file"));
    };
    machine.run(&sources, start, &start.routines[0])?;
    match machine.triggers.first() {
        Some((_, line, _)) => {
            let problem = "no motion follows the trigger";
            Err(ProgramError::new(&start.file, *line, problem))
        }
        None => Ok(machine.steps),
    }
}

struct Machine {
    lists: HashMap<String, Numbers>,
    settings: Settings,
    kept: Kept,
    /// Whether a motion has been.
    moved: bool,
    /// Triggers that wait for the next motion.
    triggers: Vec<Trigger>,
    calls: usize,
    steps: Vec<Step>,
}

struct Frame<'a> {
    source: &'a Source,
    line: usize,
}

impl Machine {
    fn run(&mut self, all: &[Source], source: &Source, part: &Routine) -> Result<(), ProgramError> {
        let fail = |line, problem| ProgramError::new(&source.file, line, problem);
        if self.calls == CALLS_DEEP {
            let problem = "routines call each other without end".into();
            return Err(fail(part.line, problem));
        }
        self.calls += 1;
        for (line, tokens, comment) in &part.lines {
            let frame = Frame {
                source,
                line: *line,
            };
            let call = self.line(&frame, tokens);
            if let Some(name) = call.map_err(|problem| fail(*line, problem))? {
                let called = called(all, source, name);
                let (source, routine) = called.map_err(|problem| fail(*line, problem))?;
                self.run(all, source, routine)?;
            }
            let label = comment.iter().filter(|text| text.starts_with("layer"));
            let notes = label.map(|text| Step::Note { text: text.clone() });
            self.steps.extend(notes);
        }
        self.calls -= 1;
        Ok(())
    }

    /// Does a line; a call gives the name of what has to run.
    fn line<'a>(&mut self, frame: &Frame, tokens: &'a [Token]) -> Result<Option<&'a str>, String> {
        let mut words = Cursor { tokens };
        if words.peek().is_none() {
            return Ok(None);
        }
        match words.name("")? {
            "PTP" => self.ptp(frame, &mut words)?,
            "LIN" => self.lin(frame, &mut words)?,
            "TRIGGER" => self.trigger(frame, &mut words)?,
            "BAS" => self.basic(frame, &mut words)?,
            "WAIT" => {
                words.keyword("SEC")?;
                let seconds = self.number(frame, &mut words)?;
                words.end()?;
                if seconds < 0.0 {
                    return Err("a time below 0".into());
                }
                self.stop_advance_run();
                self.steps.push(Step::Wait { seconds });
            }
            "$OUT" | "$ANOUT" => {
                let mut words = Cursor { tokens };
                let (name, value) = self.output_value(frame, &mut words)?;
                words.end()?;
                self.stop_advance_run();
                let output = Step::output(&frame.source.file, frame.line, name, value);
                self.steps.push(output);
            }
            variable if variable.starts_with('$') => {
                words.mark('=')?;
                let mut settings = self.settings.clone();
                settings.assign(variable, &mut words, |words| self.number(frame, words))?;
                if settings.tool != self.settings.tool || settings.base != self.settings.base {
                    self.kept.forget_pose();
                }
                self.settings = settings;
            }
            name if words.takes('(') => {
                words.mark(')')?;
                return words.end().map(|()| Some(name));
            }
            name => return Err(format!("{name} is not covered")),
        }
        Ok(None)
    }

    fn basic(&mut self, frame: &Frame, words: &mut Cursor) -> Result<(), String> {
        words.mark('(')?;
        words.mark('#')?;
        let command = words.name("")?;
        words.mark(',')?;
        let value = self.number(frame, words)?;
        words.mark(')')?;
        words.end()?;
        if command == "INITMOV" {
            self.kept.forget_pose();
        }
        self.settings.basic(command, value)
    }

    /// A number, or the name of one in the file's list, either with a sign.
    fn number(&self, frame: &Frame, words: &mut Cursor) -> Result<f64, String> {
        let sign = if words.takes('-') { -1.0 } else { 1.0 };
        if sign > 0.0 {
            words.takes('+');
        }
        match words.next() {
            Some(Token::Number(value)) => Ok(sign * value),
            Some(Token::Word(name)) => {
                let list = self.lists.get(&frame.source.module);
                let value = list.and_then(|list| list.get(name)).copied().flatten();
                let value = value.ok_or_else(|| format!("{name} is not known as a number"))?;
                Ok(sign * value)
            }
            other => Err(format!("a number is missing before {other:?}")),
        }
    }

    fn output_value(&self, frame: &Frame, words: &mut Cursor) -> Result<(String, f64), String> {
        let variable = words.name("")?;
        words.mark('[')?;
        let index = self.number(frame, words)?;
        words.mark(']')?;
        words.mark('=')?;
        let (value, count) = match variable {
            "$OUT" if words.takes_word("TRUE") => (1.0, DIGITAL_OUTPUTS),
            "$OUT" => (words.keyword("FALSE").map(|()| 0.0)?, DIGITAL_OUTPUTS),
            "$ANOUT" => (self.number(frame, words)?, ANALOG_OUTPUTS),
            _ => return Err(format!("{variable} is no output")),
        };
        if index.fract() != 0.0 || !(1.0..=count).contains(&index) || value.abs() > 1.0 {
            return Err(format!("{variable}[{index}]={value} is out of range"));
        }
        Ok((format!("{variable}[{index}]"), value))
    }

    fn stop_advance_run(&mut self) {
        let is_motion = |step: &&mut Step| matches!(step, Step::Move(_));
        if let Some(Step::Move(motion)) = self.steps.iter_mut().rev().find(is_motion) {
            motion.blend_mm = 0.0;
        }
    }
}

/// The routine that a name calls: of the same file, or the first one of another.
fn called<'a>(
    sources: &'a [Source],
    source: &'a Source,
    name: &str,
) -> Result<(&'a Source, &'a Routine), String> {
    let own = source.routines.iter().map(|routine| (source, routine));
    let others = sources.iter().map(|source| (source, &source.routines[0]));
    let found = own.chain(others).find(|(_, routine)| routine.name == name);
    found.ok_or_else(|| format!("there is no routine {name}"))
}

#[cfg(test)]
mod tests {
    use super::super::shown;
    use super::*;

    fn run(statements: &str) -> Result<Vec<Step>, String> {
        let text = format!("&ACCESS RVP\nDEF a( )\n{statements}\nEND\nDEF sub( )\n;layer 2\nEND\n");
        let other = "DEF layer1( )\n; layer 1 of 2\nEND\nDEF hidden( )\nEND\n".to_owned();
        let list = "DEFDAT a\nDECL REAL T=0.5\nENDDAT\n".to_owned();
        let files = [("a.src", text), ("layer1.src", other), ("A.dat", list)];
        let files = files.map(|(name, text)| SourceFile {
            name: name.into(),
            text,
        });
        run_krl(&files, "A").map_err(|error| error.to_string())
    }

    /// What the tests of motions begin with: seven lines, two motions.
    const START: &str = "BAS (#INITMOV,0 )\nBAS(#VEL_PTP,20)\n$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[2]\n$VEL.CP=0.25\n\
                         $APO.CDIS=20\nPTP {A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0,E1 5}\n\
                         LIN {X 1109.41,Y -0.51,Z 715,A 95.44,B 73.45,C 70.95} C_DIS\n";

    /// Goal: a contour runs with the manual's units, triggers stand where they are bound to, calls run, and what stops
    /// the advance run ends the motion before it exactly. Method: a home position and a line of the contour in "Expert
    /// Programming", chapter on approximate positioning (from memory, not held against its text), with an external axis
    /// and turning speeds, quarter turns by A, B and C; one trigger of each kind, two calls, a time.
    #[test]
    fn a_contour() {
        let text = format!(
            "{START}$VEL.ORI1=90\nLIN {{A 90,B 90,C 0}}\n$VEL.ORI2=60\nLIN {{A 90,B 0,C 90}}\n\
             TRIGGER WHEN DISTANCE=0 DELAY=20 DO $OUT[8]=TRUE\nTRIGGER WHEN DISTANCE = 1 DELAY = -10 DO $ANOUT[1]=0.5\n\
             TRIGGER WHEN PATH=-15 DELAY=0 DO $OUT[8]=FALSE\nLIN {{X 100}} C_DIS\nlayer1( ) ; layer 1 is done\nsub( )\n\
             LIN {{X 110}} C_DIS\nWAIT SEC T\n$BASE=$NULLFRAME\nPTP {{A1 1,A2 0,A3 0,A4 0,A5 0,A6 0}}\n$OUT[9]=FALSE"
        );
        let steps = run(&text).expect("a program");
        let expected = "\
             a.src:9 Joints [inf, inf, 0.20, 0.00] (\"1\", \"2\", None) Joints { degrees: [0.0, -90.0, 90.0, 0.0, \
             0.0, 0.0], external: [5.0] \
             }\n\
             a.src:10 Line [250.00, inf, 1.00, 20.00] (\"1\", \"2\", None) [1109.4, -0.5, 715.0] [[-0.0, 0.3, -1.0], \
             [0.9, 0.4, 0.1]] [5.0] \
             None\n\
             a.src:12 Line [250.00, 90.00, 1.00, 0.00] (\"1\", \"2\", None) [1109.4, -0.5, 715.0] [[0.0, 0.0, -1.0], \
             [0.0, 1.0, 0.0]] [5.0] \
             None\n\
             a.src:14 Line [250.00, 60.00, 1.00, 0.00] (\"1\", \"2\", None) [1109.4, -0.5, 715.0] [[0.0, 1.0, -0.0], \
             [1.0, -0.0, 0.0]] [5.0] \
             None\n\
             Output { file: \"a.src\", line: 15, name: \"$OUT[8]\", value: 1.00, before_end_mm: 0.00, delay_s: 0.02 }\n\
             a.src:18 Line [250.00, 60.00, 1.00, 20.00] (\"1\", \"2\", None) [100.0, -0.5, 715.0] [[0.0, 1.0, -0.0], \
             [1.0, -0.0, 0.0]] [5.0] \
             None\n\
             Output { file: \"a.src\", line: 16, name: \"$ANOUT[1]\", value: 0.50, before_end_mm: 0.00, delay_s: -0.01 }\n\
             Output { file: \"a.src\", line: 17, name: \"$OUT[8]\", value: 0.00, before_end_mm: 15.00, delay_s: 0.00 }\n\
             Note { text: \"layer 1 of 2\" }\n\
             Note { text: \"layer 1 is done\" }\n\
             Note { text: \"layer 2\" }\n\
             a.src:21 Line [250.00, 60.00, 1.00, 0.00] (\"1\", \"2\", None) [110.0, -0.5, 715.0] [[0.0, 1.0, -0.0], \
             [1.0, -0.0, 0.0]] [5.0] \
             None\n\
             Wait { seconds: 0.50 }\n\
             a.src:24 Joints [inf, inf, 0.20, 0.00] (\"1\", \"0\", None) Joints { degrees: [1.0, 0.0, 0.0, 0.0, 0.0, \
             0.0], external: [5.0] \
             }\n\
             Output { file: \"a.src\", line: 25, name: \"$OUT[9]\", value: 0.00, before_end_mm: 0.00, delay_s: 0.00 }\n";
        assert_eq!(shown(&steps), expected);
    }

    /// Goal: what is not known is refused where it stands. Method: one statement each.
    #[test]
    fn refusals() {
        for text in "PTP {A1 0} C_PTP|PTP {A1 0}|PTP {X 1}|LIN {A1 0,A2 0,A3 0,A4 0,A5 0,A6 0}|\
             LIN {X 1} C_VEL|LIN {X 1,S 2}|LIN {X 1,X 2}|LIN {X 1|LIN {E1 1}|SPLINE|\
             TRIGGER WHEN DISTANCE=1 DELAY=0 DO $OUT[1]=TRUE|\
             TRIGGER WHEN DISTANCE=2 DELAY=0 DO $OUT[1]=TRUE|$OUT[0]=TRUE|$ANOUT[1]=1.5|$VEL.CP=0|\
             $ADVANCE=6|$TOOL=TOOL_DATA[17]|$ORI_TYPE=#CONSTANT|$OV_PRO=50|BAS(#VEL_CP,1)|\
             IF TRUE THEN|T=1|hidden( )|a( )"
            .split('|')
        {
            let line = if text == "a( )" { 2 } else { 11 };
            let error = run(&(START.to_owned() + text)).expect_err(text);
            assert!(error.starts_with(&format!("a.src:{line}: ")), "{error}");
        }
        assert!(run(&(START.to_owned() + "$BASE=BASE_DATA[1]\nLIN {X 1}")).is_err());
        assert!(run("LIN {X 1,Y 2,Z 3,A 0,B 0,C 0}").is_err());
    }
}
