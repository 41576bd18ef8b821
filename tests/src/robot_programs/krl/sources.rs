//! Files of a KRL program: routines of `.src` files, numbers of `.dat` files.
//!
//! In: files. Out: routines as lines of tokens, declared numbers. Source: file header, DEF, DEFDAT, DECL after "KUKA
//! System Software 8.3, Operating and Programming Instructions for System Integrators", not held against the manual's
//! own text. The first routine of a file has the file's name and can be called from other files, others only within
//! theirs; a list's data are seen in its own file. Not covered: GLOBAL, PUBLIC, EXT, data of routines, parameters.

use std::collections::HashMap;

use super::super::tokens::{Cursor, Lexis, Token};
use super::super::{ProgramError, SourceFile};

/// KRL's words and marks.
const LEXIS: Lexis = Lexis {
    comment: ';',
    starts: "_$",
    inside: "_$.",
    marks: "{}()[],=#-+",
    is_plain: false,
};
/// Characters at most of a name, and of a line (so that every editor and release takes it; the manuals state no limit
/// of lines that is sure).
const NAME_CHARACTERS: usize = 24;
const LINE_CHARACTERS: usize = 255;
/// Lines that the editor writes before a program.
const HEADERS: [&str; 5] = ["&ACCESS", "&COMMENT", "&PARAM", "&REL", "&USER"];
/// Words that are no names of data or routines.
const KEYWORDS: &str = "BAS CIRC CONTINUE DECL DEF DEFDAT DEFFCT DO ELSE END ENDDAT ENDIF ENDSPLINE EXIT EXT FOR GLOBAL \
    HALT IF INTERRUPT LIN LOOP PTP SLIN SPL SPLINE TRIGGER WAIT WHILE WITH REAL INT FRAME POS E6POS AXIS E6AXIS";

/// Numbers of a data list by name; those without a value are there, too.
pub type Numbers = HashMap<String, Option<f64>>;

/// A line that holds something: its number from 1, its tokens and comment.
pub type Line = (usize, Vec<Token>, Option<String>);

/// A routine: the line of its DEF, its name, and the lines between DEF and END.
pub struct Routine {
    pub(super) line: usize,
    pub(super) name: String,
    pub(super) lines: Vec<Line>,
}

/// A `.src` file: its name, the same in upper case without the ending, and one routine at least.
pub struct Source {
    pub(super) file: String,
    pub(super) module: String,
    pub(super) routines: Vec<Routine>,
}

/// Reads all files: the sources, and the numbers of data lists by their files' names in upper case.
pub fn read(files: &[SourceFile]) -> Result<(Vec<Source>, HashMap<String, Numbers>), ProgramError> {
    let (mut sources, mut lists) = (Vec::<Source>::new(), HashMap::new());
    for file in files {
        let fail = |(line, problem)| ProgramError::new(&file.name, line, problem);
        let (module, ending) = file.name.rsplit_once('.').unwrap_or((&file.name, ""));
        check_name(module).map_err(|problem| fail((1, problem)))?;
        let module = module.to_ascii_uppercase();
        let lines = lines_of(&file.text).map_err(fail)?;
        let new = match ending.to_ascii_lowercase().as_str() {
            "src" => {
                let new = !sources.iter().any(|other| other.module == module);
                let routines = routines_of(lines, &module).map_err(fail)?;
                sources.push(Source {
                    file: file.name.clone(),
                    module,
                    routines,
                });
                new
            }
            "dat" => {
                let numbers = data_list(&lines, &module).map_err(fail)?;
                lists.insert(module, numbers).is_none()
            }
            _ => false,
        };
        if !new {
            return Err(fail((1, "neither a new .src nor a new .dat file".into())));
        }
    }
    Ok((sources, lists))
}

fn check_name(name: &str) -> Result<(), String> {
    let letters = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    let begins = !name.starts_with(|c: char| c.is_ascii_digit());
    let found = (letters && begins && name.len() <= NAME_CHARACTERS).then_some(());
    found.ok_or_else(|| format!("{name} is no name of {NAME_CHARACTERS} characters at most"))
}

/// The lines of a file after its header, words in upper case.
fn lines_of(text: &str) -> Result<Vec<Line>, (usize, String)> {
    let mut lines: Vec<Line> = Vec::new();
    for (index, text) in text.lines().enumerate() {
        let number = index + 1;
        if text.starts_with('&') {
            let name = text.split_whitespace().next().unwrap_or_default();
            if !lines.is_empty() || !HEADERS.contains(&name) {
                return Err((number, format!("{name} is not understood there")));
            }
            continue;
        }
        if text.chars().count() > LINE_CHARACTERS {
            return Err((number, format!("more than {LINE_CHARACTERS} characters")));
        }
        let (mut tokens, comment) = LEXIS.split(text).map_err(|problem| (number, problem))?;
        for token in &mut tokens {
            if let Token::Word(word) = token {
                word.make_ascii_uppercase();
            }
        }
        if !tokens.is_empty() || comment.is_some() {
            lines.push((number, tokens, comment.map(str::to_owned)));
        }
    }
    Ok(lines)
}

fn routines_of(lines: Vec<Line>, module: &str) -> Result<Vec<Routine>, (usize, String)> {
    let mut routines: Vec<Routine> = Vec::new();
    let mut open: Option<Routine> = None;
    let last = lines.last().map_or(1, |line| line.0);
    for line in lines {
        let number = line.0;
        match &mut open {
            Some(_) if line.1 == [Token::Word("END".into())] => routines.extend(open.take()),
            Some(routine) => routine.lines.push(line),
            None if line.1.is_empty() => {}
            None => {
                let name = head(&line.1).map_err(|problem| (number, problem))?;
                let twice = routines.iter().any(|other| other.name == name);
                if twice || (routines.is_empty() && name != module) {
                    let problem = format!("{name} is there twice, or not the file's name");
                    return Err((number, problem));
                }
                open = Some(Routine {
                    line: number,
                    name,
                    lines: Vec::new(),
                });
            }
        }
    }
    if open.is_some() || routines.is_empty() {
        return Err((last, "there is no DEF, or one without END".into()));
    }
    Ok(routines)
}

fn head(tokens: &[Token]) -> Result<String, String> {
    let mut words = Cursor { tokens };
    words.keyword("DEF")?;
    let name = words.name(KEYWORDS)?;
    check_name(name)?;
    words.mark('(')?;
    words.mark(')')?;
    words.end().map(|()| name.into())
}

fn data_list(lines: &[Line], module: &str) -> Result<Numbers, (usize, String)> {
    let mut numbers = Numbers::new();
    let expected = ["DEFDAT", module].map(|word| Token::Word(word.into()));
    let end = [Token::Word("ENDDAT".into())];
    let mut lines = lines.iter().filter(|line| !line.1.is_empty());
    let (mut last, head) = lines
        .next()
        .map_or((1, &[][..]), |line| (line.0, &line.1[..]));
    if head != expected {
        return Err((last, format!("DEFDAT {module} is missing")));
    }
    for line in lines.by_ref() {
        last = line.0;
        if line.1 == end {
            return match lines.next() {
                Some(line) => Err((line.0, "there is text after ENDDAT".into())),
                None => Ok(numbers),
            };
        }
        let mut words = Cursor { tokens: &line.1 };
        declare(&mut words, &mut numbers).map_err(|problem| (last, problem))?;
    }
    Err((last, "there is no ENDDAT".into()))
}

/// `[DECL] REAL|INT NAME [= value] {, NAME [= value]}`.
fn declare(words: &mut Cursor, numbers: &mut Numbers) -> Result<(), String> {
    words.takes_word("DECL");
    let is_integer = words.takes_word("INT");
    if !is_integer {
        words.keyword("REAL")?;
    }
    loop {
        let name = words.name(KEYWORDS)?;
        check_name(name)?;
        let mut value = None;
        if words.takes('=') {
            let sign = if words.takes('-') { -1.0 } else { 1.0 };
            value = match words.next() {
                Some(Token::Number(number)) if !is_integer || number.fract() == 0.0 => {
                    Some(sign * number)
                }
                other => return Err(format!("{other:?} is no value of {name}")),
            };
        }
        if numbers.insert(name.into(), value).is_some() {
            return Err(format!("{name} is declared twice"));
        }
        if !words.takes(',') {
            return words.end();
        }
    }
}
