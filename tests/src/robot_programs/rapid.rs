//! Programs in RAPID, the language of ABB's controllers, run as the manuals say.
//!
//! In: the modules of a program and the procedure that starts. Out: [`Step`]s in the order of execution. What is bound
//! to the end of a motion (TriggL) follows that motion; the speed of motions of joints is a speed of the tip, as in the
//! manual, and their share is 1. Sources: ABB "Technical reference manual, RAPID Instructions, Functions and Data
//! types" (3HAC050917) and "RAPID kernel" (3HAC050946) as they are quoted in public texts; not held against the
//! manuals' own text. Loaded at the start is the module of the procedure that starts; all else by Load. Not covered:
//! program flow, assignments, other motions than MoveAbsJ, MoveL and TriggL, what SetDO or WaitTime do ahead of a
//! fly-by point; ConfL and SingArea change no step.

mod data;
mod instructions;
mod syntax;

use std::collections::HashMap;

use super::{ProgramError, SourceFile, Step};
use data::{Sight, text};
use instructions::{Call, Trigger, is_instruction};
use syntax::{Action, Declaration, Module, Procedure, module_of};

/// Procedures that call each other this deep are taken for an endless recursion.
const CALLS_DEEP: usize = 100;

/// Runs a program from the procedure `main` on.
pub fn run_rapid(files: &[SourceFile], main: &str) -> Result<Vec<Step>, ProgramError> {
    let mut modules = Vec::new();
    for file in files {
        if !file.name.to_lowercase().ends_with(".mod") {
            return Err(ProgramError::new(&file.name, 1, "this is no module"));
        }
        modules.push(module_of(file)?);
    }
    let mut machine = Machine {
        modules: &modules,
        loaded: Vec::new(),
        running: Vec::new(),
        paths: HashMap::new(),
        triggers: HashMap::new(),
        steps: Vec::new(),
    };
    let holds = |&place: &usize| procedure_of(&modules[place], main).is_some();
    let holders: Vec<usize> = (0..modules.len()).filter(holds).collect();
    let [start] = holders[..] else {
        let problem = format!("{} modules have a procedure {main}", holders.len());
        return Err(ProgramError::new("program", 1, problem));
    };
    machine.load(start)?;
    let called = machine.called(main);
    let (place, procedure) = called.map_err(|problem| ProgramError::new("program", 1, problem))?;
    machine.run(place, procedure)?;
    Ok(machine.steps)
}

fn procedure_of<'a>(module: &'a Module, name: &str) -> Option<&'a Procedure> {
    let mut procedures = module.procedures.iter();
    procedures.find(|procedure| procedure.name.eq_ignore_ascii_case(name))
}

/// The controller: its modules by their places, those that are loaded, those of the running procedures (outermost first), the
/// paths by which modules were loaded, and the triggdata that were set, by their declarations.
struct Machine<'a> {
    modules: &'a [Module],
    loaded: Vec<usize>,
    running: Vec<usize>,
    paths: HashMap<String, usize>,
    triggers: HashMap<*const Declaration, Trigger>,
    steps: Vec<Step>,
}

impl<'a> Machine<'a> {
    /// The procedure that a name calls, and the place of its module.
    fn called(&self, name: &str) -> Result<(usize, &'a Procedure), String> {
        let modules = self.modules;
        let in_module = |&place: &usize| Some((place, procedure_of(&modules[place], name)?));
        let found = self.loaded.iter().find_map(in_module);
        found.ok_or_else(|| format!("no loaded module has a procedure {name}"))
    }

    fn run(&mut self, place: usize, procedure: &'a Procedure) -> Result<(), ProgramError> {
        let file = &self.modules[place].file;
        if self.running.len() == CALLS_DEEP {
            return Err(ProgramError::new(file, procedure.line, "calls without end"));
        }
        self.running.push(place);
        for (line, action) in &procedure.statements {
            let called = self.statement((file, *line), action);
            let called = called.map_err(|problem| ProgramError::new(file, *line, problem))?;
            if let Some((place, procedure)) = called {
                self.run(place, procedure)?;
            }
        }
        self.running.pop();
        Ok(())
    }

    /// Does a statement; a call gives what has to run.
    fn statement(
        &mut self,
        (file, line): (&'a str, usize),
        action: &'a Action,
    ) -> Result<Option<(usize, &'a Procedure)>, String> {
        match action {
            Action::Comment(text) => {
                if text.starts_with("layer") {
                    self.steps.push(Step::Note { text: text.clone() });
                }
                Ok(None)
            }
            Action::LateCall(name) => self.called(&text(name)?).map(Some),
            Action::Instruction(name, arguments) => {
                let lower = name.to_lowercase();
                if is_instruction(&lower) {
                    let modules = self.modules;
                    let loaded = self.loaded.iter().map(|&place| &modules[place].data[..]);
                    let data = loaded.collect();
                    let call = Call {
                        sight: Sight { file, data },
                        line,
                        name: lower,
                        arguments,
                    };
                    self.instruction(&call)?;
                    return Ok(None);
                }
                if !arguments.required.is_empty() || !arguments.optional.is_empty() {
                    return Err(format!("the instruction {name} is not covered"));
                }
                self.called(name).map(Some)
            }
        }
    }

    /// Loads a module; its names may not be taken.
    fn load(&mut self, new: usize) -> Result<(), ProgramError> {
        let module = &self.modules[new];
        let fail = |line, problem: String| Err(ProgramError::new(&module.file, line, problem));
        if self.loaded.contains(&new) {
            return fail(1, format!("{} is loaded already", module.name));
        }
        let mut taken = Vec::new();
        for place in self.loaded.iter().copied().chain([new]) {
            let module = &self.modules[place];
            let data = module.data.iter().map(|data| (data.line, &data.name));
            let procedures = module.procedures.iter();
            let procedures = procedures.map(|procedure| (procedure.line, &procedure.name));
            for (line, name) in [(1, &module.name)]
                .into_iter()
                .chain(data)
                .chain(procedures)
            {
                if taken.contains(&name) || is_instruction(name) {
                    return fail(line, format!("the name {name} is taken"));
                }
                taken.push(name);
            }
        }
        self.loaded.push(new);
        Ok(())
    }

    /// Load: the module gets the path by which UnLoad names it.
    fn load_file(&mut self, path: &str) -> Result<(), String> {
        let name = path.rsplit(['/', ':']).next().unwrap_or(path);
        let mut modules = self.modules.iter();
        let found = modules.position(|module| module.file.eq_ignore_ascii_case(name));
        let found = found.ok_or_else(|| format!("there is no file {name}"))?;
        // The line of a fault in the loaded file stands in its own message.
        self.load(found).map_err(|error| error.to_string())?;
        self.paths.insert(path.to_lowercase(), found);
        Ok(())
    }

    /// UnLoad: only what Load loaded by the same path, and no module that runs.
    fn unload_file(&mut self, path: &str) -> Result<(), String> {
        let Some(found) = self.paths.remove(&path.to_lowercase()) else {
            return Err(format!("nothing was loaded by the path {path}"));
        };
        if self.running.contains(&found) {
            return Err(format!("{path} is running"));
        }
        self.loaded.retain(|&module| module != found);
        for data in &self.modules[found].data {
            self.triggers.remove(&std::ptr::from_ref(data));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::shown;
    use super::*;

    /// The data p15 of the manual's chapter on robtarget, with one external axis left out.
    const P15: &str = "[[600,500,225.5],[1,0,0,0],[1,1,0,0],[11,9E9,9E9,9E9,9E9,9E9]]";

    fn run(statements: &str) -> Result<Vec<Step>, String> {
        let text = format!(
            "MODULE part\nCONST num flow:=2.5;\nVAR triggdata gunon;\nPROC main()\n{}\nENDPROC\nENDMODULE\n",
            statements.replace("p1,", &format!("{P15},"))
        );
        let second = "MODULE PART_A\nPROC routine_a()\n! layer 1\nENDPROC\nENDMODULE\n".to_owned();
        let files = [("part.mod", text), ("PART_A.MOD", second)].map(|(name, text)| SourceFile {
            name: name.into(),
            text,
        });
        run_rapid(&files, "main").map_err(|error| error.to_string())
    }

    /// Goal: instructions mean what the manual says. Method: its examples of robtarget (p15), MoveL (2200 mm/s and a
    /// zone of 45 mm in place of v2000 and z40), TriggIO (0.2 s before the end), TriggEquip (10 mm before the end, 0.1
    /// s earlier for the lag of the gun) and Load (PART_A.MOD from diskhome), as public texts quote them; then one of
    /// each other.
    #[test]
    fn examples_of_the_manual() {
        let steps = run("MoveL p1, v2000 \\V:=2200, z40 \\Z:=45, grip3 \\WObj:=fixture;\n\
             TriggIO gunon, 0.2\\Time\\DOp:=gun, 1;\nTriggL p1, v500, gunon, fine, grip3;\n\
             TriggEquip gunon, 10, 0.1 \\DOp:=gun, 1;\nTriggL p1, v500, gunon, z50, grip3;\n\
             Load \\Dynamic, diskhome \\File:=\"PART_A.MOD\";\n%\"routine_a\"%;\nroutine_a;\n\
             UnLoad diskhome \\File:=\"PART_A.MOD\";\nConfL\\On;\nSingArea\\Off;\nTPWrite \"a\"\"b\\\\\";\n! a remark\n\
             MoveAbsJ [[0,10,20,0,30,0],[100,9E9,9E9,9E9,9E9,9E9]],[12.5,40,0,0],fine,tool0;\nWaitTime 0.5;\n\
             SetAO ao_flow, flow;\nSetDO do_gun, high;")
        .expect("a program");
        let expected = "\
             part.mod:5 Line [2200.00, 500.00, 1.00, 45.00] (\"grip3\", \"fixture\", None) [600.0, 500.0, 225.5] \
             [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]] \
             [11.0] Some(Quadrants { cf: [1, 1, 0], cfx: 0 })\n\
             part.mod:7 Line [500.00, 500.00, 1.00, 0.00] (\"grip3\", \"wobj0\", None) [600.0, 500.0, 225.5] [[1.0, \
             0.0, 0.0], [0.0, 0.0, 1.0]] [11.0] \
             Some(Quadrants { cf: [1, 1, 0], cfx: 0 })\n\
             Output { file: \"part.mod\", line: 7, name: \"gun\", value: 1.00, before_end_mm: 0.00, delay_s: -0.20 }\n\
             part.mod:9 Line [500.00, 500.00, 1.00, 50.00] (\"grip3\", \"wobj0\", None) [600.0, 500.0, 225.5] [[1.0, \
             0.0, 0.0], [0.0, 0.0, 1.0]] [11.0] \
             Some(Quadrants { cf: [1, 1, 0], cfx: 0 })\n\
             Output { file: \"part.mod\", line: 9, name: \"gun\", value: 1.00, before_end_mm: 10.00, delay_s: -0.10 }\n\
             Note { text: \"layer 1\" }\n\
             Note { text: \"layer 1\" }\n\
             Note { text: \"a\\\"b\\\\\" }\n\
             part.mod:18 Joints [12.50, 40.00, 1.00, 0.00] (\"tool0\", \"wobj0\", None) Joints { degrees: [0.0, 10.0, \
             20.0, 0.0, 30.0, 0.0], external: \
             [100.0] }\n\
             Wait { seconds: 0.50 }\n\
             Output { file: \"part.mod\", line: 20, name: \"ao_flow\", value: 2.50, before_end_mm: 0.00, delay_s: 0.00 }\n\
             Output { file: \"part.mod\", line: 21, name: \"do_gun\", value: 1.00, before_end_mm: 0.00, delay_s: 0.00 }\n";
        assert_eq!(shown(&steps), expected);
    }

    /// Goal: what is not known is refused where it stands. Method: one statement each.
    #[test]
    fn refusals() {
        for text in
            "MoveL p2, v100, z1, grip3;|MoveL p1, v101, z1, grip3;|MoveL p1, v100, z2, grip3;|\
             MoveL p1, v100, fine \\Z:=2, grip3;|MoveL p1, v100, z1, gunon;|\
             MoveL p1 v100, z1, grip3;|\
             MoveL [[1,2,3],[1.00001,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v5,z1,grip3;|\
             MoveL [[1,2,3],[1,0,0,0],[0,0,0,8],[9E9,9E9,9E9,9E9,9E9,9E9]],v5,z1,grip3;|\
             MoveAbsJ [[0,0,0,0,0,0],[9E9,1,9E9,9E9,9E9,9E9]],v5,fine,tool0;|\
             MoveJ p1, v100, z1, grip3;|TriggL p1, v500, gunon, fine, grip3;|SetDO do_gun, 2;|\
             WaitTime -1;|main;|routine_a;|ConfL;|RETURN;|x:=1;|UnLoad \"HOME:/PART_A.MOD\";|\
             VAR string s;|VAR num v100:=1;"
                .split('|')
        {
            let error = run(text).expect_err(text);
            let line = if text == "main;" { 4 } else { 5 };
            assert!(error.starts_with(&format!("part.mod:{line}: ")), "{error}");
        }
    }
}
