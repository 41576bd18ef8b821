//! Tokens of a RAPID module to declarations, procedures and statements.
//!
//! In: a file. Out: a [`Module`]. Source: the grammar after ABB's "RAPID kernel" (3HAC050946), not held against the
//! manual's own text: module, data and routine declarations, procedure calls and argument lists; in a module all data
//! stand before the routines. Not covered: attributes, LOCAL, TASK, routine parameters, functions, traps, other data
//! than num and triggdata, program flow, assignments and expressions (all refused).

use super::super::tokens::{Cursor, Lexis, Token};
use super::super::{ProgramError, SourceFile};
use super::data::is_predefined;

/// RAPID's words and marks.
const LEXIS: Lexis = Lexis {
    comment: '!',
    starts: "",
    inside: "_",
    marks: ";,\\[]()%-+\"",
    is_plain: false,
};
/// Characters at most of an identifier, of a string, and of a line (so that every editor and release takes it; the
/// manuals state no limit of lines that is sure).
const NAME_CHARACTERS: usize = 32;
const STRING_CHARACTERS: usize = 80;
const LINE_CHARACTERS: usize = 255;
/// Words that are no names, those of program flow among them.
const RESERVED: &str = "alias and backward case connect const default div do else elseif endfor endfunc endif \
    endmodule endproc endrecord endtest endtrap endwhile error exit false for from func goto if inout local mod module \
    nostepin not noview or pers proc raise readonly record retry return step sysmodule task test then to trap true \
    trynext undo var viewonly while with xor";

/// A number, a string, a name as it is written, or values in brackets.
#[derive(Clone, Debug, PartialEq)]
pub enum Expression {
    Number(f64),
    Text(String),
    Name(String),
    Aggregate(Vec<Expression>),
}

/// Arguments of an instruction: those without a name, and those after a backslash with their name in lower case, how
/// many required ones stand before, and the value if there is one.
#[derive(Default)]
pub struct Arguments {
    pub(super) required: Vec<Expression>,
    pub(super) optional: Vec<(String, usize, Option<Expression>)>,
}

impl Arguments {
    /// Checks the number of required arguments and that each optional one is among those allowed: its name, how many
    /// required ones stand before it, whether it has a value.
    pub fn check(&self, required: usize, allowed: &[(&str, usize, bool)]) -> Result<(), String> {
        let count = self.required.len();
        if count != required {
            return Err(format!("{count} required arguments instead of {required}"));
        }
        for (at, (name, place, value)) in self.optional.iter().enumerate() {
            if !allowed.contains(&(name, *place, value.is_some())) {
                return Err(format!("\\{name} is not understood there"));
            }
            if self.optional[..at].iter().any(|(other, ..)| other == name) {
                return Err(format!("\\{name} is given twice"));
            }
        }
        Ok(())
    }

    /// Whether an optional argument is given.
    pub fn has(&self, name: &str) -> bool {
        self.optional.iter().any(|(other, ..)| other == name)
    }

    /// Value of an optional argument.
    pub fn value(&self, name: &str) -> Option<&Expression> {
        let mut named = self.optional.iter().filter(|(other, ..)| other == name);
        named.next().and_then(|(_, _, value)| value.as_ref())
    }
}

/// What a procedure does: an instruction or a call by name with the arguments, a call of the procedure whose name a
/// string has, or a comment.
pub enum Action {
    Instruction(String, Arguments),
    LateCall(Expression),
    Comment(String),
}

/// Declared data: the line, the name in lower case, and a num's value; triggdata have none.
pub struct Declaration {
    pub(super) line: usize,
    pub(super) name: String,
    pub(super) is_trigger: bool,
    pub(super) value: Option<f64>,
}

/// A procedure without parameters: its line, its name in lower case, and what it does with the lines.
pub struct Procedure {
    pub(super) line: usize,
    pub(super) name: String,
    pub(super) statements: Vec<(usize, Action)>,
}

/// A module: its file, its name in lower case, data and procedures.
pub struct Module {
    pub(super) file: String,
    pub(super) name: String,
    pub(super) data: Vec<Declaration>,
    pub(super) procedures: Vec<Procedure>,
}

/// Reads a module.
pub fn module_of(file: &SourceFile) -> Result<Module, ProgramError> {
    let fail = |line, problem| ProgramError::new(&file.name, line, problem);
    let (mut tokens, mut lines, mut comments) = (Vec::new(), Vec::new(), Vec::new());
    for (index, text) in file.text.lines().enumerate() {
        let line = index + 1;
        let (new, comment) = line_of(text).map_err(|problem| fail(line, problem))?;
        lines.resize(lines.len() + new.len(), line);
        tokens.extend(new);
        comments.extend(comment.map(|text| (tokens.len(), line, text)));
    }
    let mut reader = Reader {
        cursor: Cursor { tokens: &tokens },
        lines: &lines,
        comments: &comments,
    };
    let module = reader.module(&file.name);
    module.map_err(|problem| fail(reader.line(), problem))
}

fn line_of(text: &str) -> Result<(Vec<Token>, Option<&str>), String> {
    if text.chars().count() > LINE_CHARACTERS {
        return Err(format!("more than {LINE_CHARACTERS} characters"));
    }
    if let Some(other) = text.chars().find(|&c| u32::from(c) > 0xff) {
        return Err(format!("'{other}' is not in ISO 8859-1"));
    }
    let (tokens, comment) = LEXIS.split(text)?;
    let is_long = |token: &Token| match token {
        Token::Word(word) => word.len() > NAME_CHARACTERS,
        Token::Text(text) => text.chars().count() > STRING_CHARACTERS,
        _ => false,
    };
    match tokens.iter().find(|token| is_long(token)) {
        Some(token) => Err(format!("{token:?} is too long")),
        None => Ok((tokens, comment)),
    }
}
/// Goes through tokens, with their lines, and the comments that are left: how many tokens stand before, the line, the text.
struct Reader<'a> {
    cursor: Cursor<'a>,
    lines: &'a [usize],
    comments: &'a [(usize, usize, &'a str)],
}

impl<'a> Reader<'a> {
    fn at(&self) -> usize {
        self.lines.len() - self.cursor.tokens.len()
    }

    /// Line of the token that comes next, or of the last one.
    fn line(&self) -> usize {
        let line = self.lines.get(self.at()).or(self.lines.last());
        line.copied().unwrap_or(1)
    }

    /// Whether a word (lower case) comes next in any case; it is passed.
    fn takes_word(&mut self, word: &str) -> bool {
        let next = self.cursor.peek();
        let found = matches!(next, Some(Token::Word(next)) if next.eq_ignore_ascii_case(word));
        found && self.cursor.next().is_some()
    }

    fn name(&mut self) -> Result<&'a str, String> {
        let name = self.cursor.name("")?;
        let mut reserved = RESERVED.split(' ');
        if reserved.any(|other| other.eq_ignore_ascii_case(name)) {
            return Err(format!("{name} is not covered, or no name"));
        }
        Ok(name)
    }

    fn module(&mut self, file: &str) -> Result<Module, String> {
        if !self.takes_word("module") {
            return Err("MODULE is missing".into());
        }
        let name = self.name()?.to_lowercase();
        let (mut data, mut procedures) = (Vec::new(), Vec::new());
        while !self.takes_word("endmodule") {
            let line = self.line();
            if self.takes_word("proc") {
                procedures.push(self.procedure(line)?);
            } else if procedures.is_empty() {
                let new = self.declaration()?;
                data.push(new.ok_or_else(|| format!("{:?} is not covered", self.cursor.peek()))?);
            } else {
                return Err("after a routine only routines may be declared".into());
            }
        }
        if self.cursor.peek().is_some() {
            return Err("there is text after ENDMODULE".into());
        }
        let file = file.into();
        Ok(Module {
            file,
            name,
            data,
            procedures,
        })
    }

    /// `CONST|VAR|PERS num name := number;` or `VAR triggdata name;`, if a declaration comes next.
    fn declaration(&mut self) -> Result<Option<Declaration>, String> {
        let line = self.line();
        let is_variable = self.takes_word("var");
        if !is_variable && !self.takes_word("const") && !self.takes_word("pers") {
            return Ok(None);
        }
        let is_trigger = self.takes_word("triggdata");
        if !is_trigger && !self.takes_word("num") {
            return Err(format!("data of {:?} are not covered", self.cursor.peek()));
        }
        let name = self.name()?.to_lowercase();
        if is_predefined(&name) {
            return Err(format!("{name} is predefined"));
        }
        let mut value = None;
        if !is_trigger && self.cursor.takes('=') {
            let Expression::Number(number) = self.expression()? else {
                return Err(format!("{name} is given no plain number"));
            };
            value = Some(number);
        }
        if value.is_none() && !is_variable {
            return Err(format!("{name} needs an initial value"));
        }
        self.cursor.mark(';')?;
        Ok(Some(Declaration {
            line,
            name,
            is_trigger,
            value,
        }))
    }

    fn procedure(&mut self, line: usize) -> Result<Procedure, String> {
        let name = self.name()?.to_lowercase();
        self.cursor.mark('(')?;
        self.cursor.mark(')')?;
        let mut first = self.at();
        let mut statements = Vec::new();
        loop {
            while let Some(((before, line, text), rest)) = self.comments.split_first()
                && *before <= self.at()
            {
                self.comments = rest;
                // One within the statement before, or before the procedure, is no label.
                if *before >= first {
                    statements.push((*line, Action::Comment((*text).to_owned())));
                }
            }
            if self.takes_word("endproc") {
                return Ok(Procedure {
                    line,
                    name,
                    statements,
                });
            }
            let line = self.line();
            statements.push((line, self.action()?));
            first = self.at();
        }
    }

    fn action(&mut self) -> Result<Action, String> {
        if self.cursor.takes('%') {
            let name = self.expression()?;
            self.cursor.mark('%')?;
            self.cursor.mark(';')?;
            return Ok(Action::LateCall(name));
        }
        let name = self.name()?.to_owned();
        Ok(Action::Instruction(name, self.arguments()?))
    }

    /// Arguments up to the semicolon. A comma may stand before a backslash and has to stand before a required argument.
    fn arguments(&mut self) -> Result<Arguments, String> {
        let mut arguments = Arguments::default();
        let mut first = true;
        while !self.cursor.takes(';') {
            let comma = self.cursor.takes(',');
            if first && comma {
                return Err("a comma before the first argument".into());
            }
            if self.cursor.takes('\\') {
                let Some(Token::Word(name)) = self.cursor.peek() else {
                    return Err("an argument's name is missing".into());
                };
                self.cursor.next();
                let given = self.cursor.takes('=');
                let value = given.then(|| self.expression()).transpose()?;
                let place = arguments.required.len();
                arguments.optional.push((name.to_lowercase(), place, value));
            } else if first || comma {
                arguments.required.push(self.expression()?);
            } else {
                return Err("',' or ';' is missing".into());
            }
            first = false;
        }
        Ok(arguments)
    }

    fn expression(&mut self) -> Result<Expression, String> {
        let minus = self.cursor.takes('-');
        let signed = minus || self.cursor.takes('+');
        let before = self.cursor.clone();
        Ok(match self.cursor.next() {
            Some(Token::Number(value)) => Expression::Number(if minus { -value } else { *value }),
            Some(Token::Text(text)) if !signed => Expression::Text(text.clone()),
            Some(Token::Word(name)) if !signed => Expression::Name(name.clone()),
            Some(Token::Mark('[')) if !signed => {
                let mut parts = vec![self.expression()?];
                while self.cursor.takes(',') {
                    parts.push(self.expression()?);
                }
                self.cursor.mark(']')?;
                Expression::Aggregate(parts)
            }
            other => {
                self.cursor = before;
                return Err(format!("a value is missing before {other:?}"));
            }
        })
    }
}
