//! Lines of a robot's language to words, numbers, texts and marks.
//!
//! In: a line and what sets its language apart. Out: [`Token`]s, a [`Cursor`] over them, and the line's comment.
//! Source: what RAPID, KRL and URScript have in common after the manuals that their interpreters name. Not covered:
//! literals that are not decimal, codes of characters in texts.

/// A name or keyword as it is written, a number without its sign, a text without its quotes, or a delimiter: one
/// character, or `:=` as `=`.
#[derive(Clone, Debug, PartialEq)]
pub enum Token {
    Word(String),
    Number(f64),
    Text(String),
    Mark(char),
}

/// What sets a language apart: what begins a comment, characters besides letters that words begin with, characters besides
/// letters and digits in words, delimiters, and whether numbers have double precision and no exponents and texts end at
/// the next quote.
pub struct Lexis {
    pub(super) comment: char,
    pub(super) starts: &'static str,
    pub(super) inside: &'static str,
    pub(super) marks: &'static str,
    pub(super) is_plain: bool,
}

impl Lexis {
    /// Tokens of a line, and its comment without what begins it.
    pub fn split<'a>(&self, line: &'a str) -> Result<(Vec<Token>, Option<&'a str>), String> {
        let (code, comment) = split_comment(line, self.comment);
        let mut tokens = Vec::new();
        let mut rest = code.trim();
        while let Some(first) = rest.chars().next() {
            let (token, length) = if first == '"' && self.marks.contains('"') {
                text(rest, self.is_plain)?
            } else if first.is_ascii_digit() || first == '.' {
                self.number(rest)?
            } else if first.is_ascii_alphabetic() || self.starts.contains(first) {
                let inside = |c: char| c.is_ascii_alphanumeric() || self.inside.contains(c);
                let length = rest.find(|c| !inside(c)).unwrap_or(rest.len());
                (Token::Word(rest[..length].to_owned()), length)
            } else if rest.starts_with(":=") && !self.marks.contains('=') {
                (Token::Mark('='), 2)
            } else if self.marks.contains(first) {
                (Token::Mark(first), 1)
            } else {
                return Err(format!("'{first}' is not understood"));
            };
            tokens.push(token);
            rest = rest[length..].trim_start();
        }
        Ok((tokens, comment))
    }

    /// A number that a text begins with, and its length.
    fn number(&self, text: &str) -> Result<(Token, usize), String> {
        let digits = |from: usize| {
            let end = text[from..].find(|c: char| !c.is_ascii_digit());
            end.map_or(text.len(), |end| from + end)
        };
        let mut end = digits(0);
        if text[end..].starts_with('.') {
            end = digits(end + 1);
        }
        if !self.is_plain && text[end..].starts_with(['e', 'E']) {
            let sign = usize::from(text[end + 1..].starts_with(['-', '+']));
            end = digits(end + 1 + sign);
        }
        let is_glued = |c: char| c.is_ascii_alphanumeric() || "_.$".contains(c);
        let number = &text[..end];
        let value = if self.is_plain {
            number.parse()
        } else {
            number.parse::<f32>().map(f64::from)
        };
        match value {
            Ok(value) if !text[end..].starts_with(is_glued) && value.is_finite() => {
                Ok((Token::Number(value), end))
            }
            _ => Err(format!("{number} is no number here")),
        }
    }
}

/// A text and its length; unless it is plain, a quote or backslash in it is written twice.
fn text(rest: &str, is_plain: bool) -> Result<(Token, usize), String> {
    let mut value = String::new();
    let mut characters = rest.char_indices().skip(1).peekable();
    while let Some((at, character)) = characters.next() {
        if character == '"' || (character == '\\' && !is_plain) {
            let twice = characters.next_if(|&(_, after)| after == character && !is_plain);
            if twice.is_none() && character == '"' {
                return Ok((Token::Text(value), at + 1));
            }
            twice.ok_or("character codes in texts are not understood")?;
        }
        value.push(character);
    }
    Err("the text does not end on its line".into())
}

/// A line's code, and what follows the first mark of a comment that is in no text.
pub fn split_comment(line: &str, mark: char) -> (&str, Option<&str>) {
    let mut quoted = false;
    let start = line.char_indices().find(|&(_, character)| {
        quoted ^= character == '"';
        character == mark && !quoted
    });
    match start {
        Some((at, _)) => (&line[..at], Some(line[at + 1..].trim())),
        None => (line, None),
    }
}

/// Goes through tokens; it holds those that are left.
#[derive(Clone, Debug)]
pub struct Cursor<'a> {
    pub(super) tokens: &'a [Token],
}

impl<'a> Cursor<'a> {
    /// The token that comes next.
    pub fn peek(&self) -> Option<&'a Token> {
        self.tokens.first()
    }

    /// The next token, which is passed.
    pub fn next(&mut self) -> Option<&'a Token> {
        let (first, rest) = self.tokens.split_first()?;
        self.tokens = rest;
        Some(first)
    }

    /// Whether a mark comes next; it is passed.
    pub fn takes(&mut self, mark: char) -> bool {
        let found = self.peek() == Some(&Token::Mark(mark));
        self.tokens = &self.tokens[usize::from(found)..];
        found
    }

    /// Whether a word comes next; it is passed.
    pub fn takes_word(&mut self, word: &str) -> bool {
        let found = matches!(self.peek(), Some(Token::Word(next)) if next == word);
        self.tokens = &self.tokens[usize::from(found)..];
        found
    }

    /// A mark has to come.
    pub fn mark(&mut self, mark: char) -> Result<(), String> {
        let found = self.takes(mark).then_some(());
        found.ok_or_else(|| format!("'{mark}' is missing"))
    }

    /// A given word has to come.
    pub fn keyword(&mut self, word: &str) -> Result<(), String> {
        let found = self.takes_word(word).then_some(());
        found.ok_or_else(|| format!("{word} is missing"))
    }

    /// A word has to come that is not among those reserved.
    pub fn name(&mut self, reserved: &str) -> Result<&'a str, String> {
        match self.peek() {
            Some(Token::Word(word)) if !reserved.split(' ').any(|other| other == word) => {
                self.next();
                Ok(word)
            }
            other => Err(format!("a name is missing before {other:?}")),
        }
    }

    /// Nothing may come any more.
    pub fn end(&self) -> Result<(), String> {
        match self.peek() {
            None => Ok(()),
            Some(token) => Err(format!("{token:?} is not understood there")),
        }
    }
}
