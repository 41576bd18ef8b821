//! Text of a URScript file: in its lines, out the tree of its statements.
//!
//! Source: numbers, variables and types, functions, and scoping after "The URScript Programming Language", Universal
//! Robots, versions 3.2 (2016) and SW 5.x/10.x (HTML script manual). Not covered, and refused: numbers with an
//! exponent, `local`, threads, conditions, loops, `return`, structs, and indexing.

use std::rc::Rc;

use super::super::tokens::{Cursor, Lexis, Token};

/// A problem and the line it stands in, from 1.
pub type LineProblem = (usize, String);

/// A value as it is written, or a sum, difference, product or quotient; a negative is a difference from 0.
#[derive(Debug)]
pub enum Expression {
    Number(f64),
    Text(String),
    Truth(bool),
    Name(String),
    List(Vec<Expression>),
    Pose(Vec<Expression>),
    Binary(char, Box<Expression>, Box<Expression>),
    Call(Call),
}

/// A call of a function: its name, and the arguments in their order with their names, where they have one.
#[derive(Debug)]
pub struct Call {
    pub(super) name: String,
    pub(super) arguments: Vec<(Option<String>, Expression)>,
}

/// What a line says: a comment without its `#`, an assignment to a name, a call of a function whose value is not used,
/// the definition of a function.
pub enum Action {
    Comment(String),
    Assign(String, Expression),
    /// An assignment to a name that all functions see.
    Global(String, Expression),
    Call(Call),
    Define(String, Rc<Function>),
}

/// A function: the names of its parameters, and what it does.
pub struct Function {
    pub(super) parameters: Vec<String>,
    pub(super) body: Vec<Statement>,
}

/// A line, from 1, and what it says.
pub type Statement = (usize, Action);

/// URScript's words and marks.
const LEXIS: Lexis = Lexis {
    comment: '#',
    starts: "_",
    inside: "_",
    marks: "()[],=:+-*/\"",
    is_plain: true,
};
/// Words of the language that are not covered here and can be no names.
const REFUSED_WORDS: &str = "if elif else while for return thread break continue halt run kill join enter_critical \
    exit_critical sec struct and or not xor pass global local def end";

/// Reads a file into its statements.
pub fn read(text: &str) -> Result<Vec<Statement>, LineProblem> {
    // The last entry is the body that is open; every entry has the name and the line of its `def`.
    let mut open: Vec<(Head, usize, Vec<Statement>)> = vec![(Head::default(), 0, Vec::new())];
    for (index, line_text) in text.lines().enumerate() {
        let line = index + 1;
        let fail = |problem| (line, problem);
        let (tokens, comment) = LEXIS.split(line_text).map_err(fail)?;
        let mut parser = Parser {
            tokens: Cursor { tokens: &tokens },
        };
        let comment = comment.map(|text| (line, Action::Comment(text.to_owned())));
        let mut statements = Vec::from_iter(comment);
        if parser.tokens.takes_word("def") {
            let head = parser.definition().map_err(fail)?;
            open.push((head, line, Vec::new()));
        } else if parser.tokens.takes_word("end") {
            let closed = open.pop().filter(|_| !open.is_empty());
            let (head, line, body) = closed.ok_or_else(|| fail("`end` without a `def`".into()))?;
            let (name, parameters) = head;
            let function = Rc::new(Function { parameters, body });
            statements.insert(0, (line, Action::Define(name, function)));
        } else if parser.tokens.peek().is_some() {
            statements.push((line, parser.statement().map_err(fail)?));
        }
        parser.tokens.end().map_err(fail)?;
        if let Some((_, _, body)) = open.last_mut() {
            body.extend(statements);
        }
    }
    match open.pop() {
        Some((_, _, body)) if open.is_empty() => Ok(body),
        Some(((name, _), line, _)) => Err((line, format!("the function {name} has no `end`"))),
        None => Ok(Vec::new()),
    }
}

/// Name and parameters of a function.
type Head = (String, Vec<String>);

struct Parser<'a> {
    tokens: Cursor<'a>,
}

impl Parser<'_> {
    fn definition(&mut self) -> Result<Head, String> {
        let name = self.tokens.name(REFUSED_WORDS)?.to_owned();
        let mut parameters = Vec::new();
        self.tokens.mark('(')?;
        while !self.tokens.takes(')') {
            if !parameters.is_empty() {
                self.tokens.mark(',')?;
            }
            parameters.push(self.tokens.name(REFUSED_WORDS)?.to_owned());
        }
        self.tokens.mark(':').map(|()| (name, parameters))
    }

    fn statement(&mut self) -> Result<Action, String> {
        if self.tokens.takes_word("global") {
            let name = self.tokens.name(REFUSED_WORDS)?.to_owned();
            self.tokens.mark('=')?;
            return Ok(Action::Global(name, self.expression()?));
        }
        let name = self.tokens.name(REFUSED_WORDS)?.to_owned();
        if self.tokens.takes('=') {
            return Ok(Action::Assign(name, self.expression()?));
        }
        self.tokens.mark('(')?;
        self.call(name).map(Action::Call)
    }

    fn call(&mut self, name: String) -> Result<Call, String> {
        let mut arguments: Vec<(Option<String>, Expression)> = Vec::new();
        while !self.tokens.takes(')') {
            if !arguments.is_empty() {
                self.tokens.mark(',')?;
            }
            let named = self.tokens.tokens.get(1) == Some(&Token::Mark('='));
            let mut given = None;
            if named {
                given = Some(self.tokens.name(REFUSED_WORDS)?.to_owned());
                self.tokens.next();
            }
            if !named && arguments.iter().any(|(earlier, _)| earlier.is_some()) {
                return Err("an argument without a name follows one with a name".to_owned());
            }
            arguments.push((given, self.expression()?));
        }
        Ok(Call { name, arguments })
    }

    fn expression(&mut self) -> Result<Expression, String> {
        self.binary(['+', '-'], |parser| parser.binary(['*', '/'], Self::factor))
    }

    /// Parts with one of two signs between them, from left to right.
    fn binary(
        &mut self,
        signs: [char; 2],
        part: impl Fn(&mut Self) -> Result<Expression, String>,
    ) -> Result<Expression, String> {
        let mut left = part(self)?;
        while let Some(sign) = signs.into_iter().find(|&sign| self.tokens.takes(sign)) {
            left = Expression::Binary(sign, Box::new(left), Box::new(part(self)?));
        }
        Ok(left)
    }

    fn factor(&mut self) -> Result<Expression, String> {
        if self.tokens.takes('-') {
            let zero = Box::new(Expression::Number(0.0));
            return Ok(Expression::Binary('-', zero, Box::new(self.factor()?)));
        }
        if self.tokens.takes('[') {
            return self.elements().map(Expression::List);
        }
        let simple = match self.tokens.peek() {
            Some(Token::Number(value)) => Expression::Number(*value),
            Some(Token::Text(text)) => Expression::Text(text.clone()),
            Some(Token::Word(name)) if name == "True" => Expression::Truth(true),
            Some(Token::Word(name)) if name == "False" => Expression::Truth(false),
            _ => return self.named(),
        };
        self.tokens.next();
        Ok(simple)
    }

    /// A pose, a call or the name of a variable.
    fn named(&mut self) -> Result<Expression, String> {
        let name = self.tokens.name(REFUSED_WORDS)?.to_owned();
        if name == "p" && self.tokens.takes('[') {
            return self.elements().map(Expression::Pose);
        }
        if self.tokens.takes('(') {
            return self.call(name).map(Expression::Call);
        }
        Ok(Expression::Name(name))
    }

    fn elements(&mut self) -> Result<Vec<Expression>, String> {
        let mut elements = Vec::new();
        while !self.tokens.takes(']') {
            if !elements.is_empty() {
                self.tokens.mark(',')?;
            }
            elements.push(self.expression()?);
        }
        Ok(elements)
    }
}
