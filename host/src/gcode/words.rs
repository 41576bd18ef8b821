//! One line of G-code -> its words and comments.
//!
//! In: a line's text and number. Out: [`Line`]. A word is a letter and a decimal number (blanks between
//! are allowed; no exponent, for E is a letter); a letter alone is a flag. `;` begins a comment, `( )`
//! holds one; `N` and a checksum `*n` (verified) frame a line; a name of several letters is a macro, and what
//! follows it a text; `O1000` alone is the number of the program.
//! Source: RS274/NGC 3 (NIST IR 6556, 2000) and what Marlin, Klipper and RepRapFirmware take beside it.
//!
//! Own code, because the published parsers drop what is needed here: `gcode` keeps numbers as f32,
//! which at 200 mm is 15 µm, and `async-gcode` wants an executor; neither knows macros.

use super::LINE_CHARS_MAX;
use crate::gcode::error;
use crate::text::refusal::{Refusal, refusal};

/// Longest number, characters.
const NUMBER_CHARS_MAX: usize = 32;
/// What stands in place of bytes that are no UTF-8: they may be a comment's, never a word's.
pub const NOT_TEXT: char = '\u{fffd}';
/// Longest piece of a line that a message repeats.
const TOLD_CHARS: usize = 24;

/// A letter, in upper case, and its number; `None` for a flag.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Word {
    /// `b'A'` to `b'Z'`.
    pub letter: u8,
    /// The number.
    pub value: Option<f64>,
}

/// What a line says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Line<'a> {
    /// Words in order, line numbers left out.
    pub words: Vec<Word>,
    /// A macro or a code with a text (`START_PRINT`, `M117 hello`), as it stands.
    pub command: Option<&'a str>,
    /// Comments in order.
    pub comments: Vec<&'a str>,
}

/// A text cut short for a message.
pub fn shortened(text: &str) -> String {
    let text = text.trim();
    let mut short: String = text.chars().take(TOLD_CHARS).collect();
    if short.len() < text.len() {
        short.push_str("...");
    }
    short
}

/// Lines of a text: they end with LF, CR LF, or CR alone.
pub fn lines(text: &str) -> impl Iterator<Item = &str> {
    let whole = text.strip_suffix('\n').unwrap_or(text);
    let ends_with_cr = |line: &str| line.len() > 1 && line.ends_with('\r');
    let without_cr = move |line| match ends_with_cr(line) {
        true => &line[..line.len() - 1],
        false => line,
    };
    whole
        .split('\n')
        .flat_map(move |line| without_cr(line).split('\r'))
}

/// The decimal number at a text's beginning, and what follows it.
pub fn number_in(text: &str) -> Option<(f64, &str)> {
    let is_number = |c: char| c.is_ascii_digit() || matches!(c, '.' | '+' | '-');
    let end = text.find(|c| !is_number(c)).unwrap_or(text.len());
    Some((text[..end].parse().ok()?, &text[end..]))
}

/// Where the comment to the line's end begins: a semicolon within `( )` is part of that comment.
fn comment_start(text: &str) -> usize {
    let mut is_open = false;
    let begins = text.bytes().position(|byte| {
        match byte {
            b'(' => is_open = true,
            b')' => is_open = false,
            _ => {}
        }
        byte == b';' && !is_open
    });
    let first = || text.find(';').unwrap_or(text.len());
    match is_open {
        // A bracket that stays open, in a text for a display.
        true => first(),
        false => begins.unwrap_or(text.len()),
    }
}

/// Reads one line.
///
/// # Errors
/// [`Refusal`] with the line.
pub fn read_line(text: &str, line: usize) -> Result<Line<'_>, Refusal> {
    let code_end = comment_start(text);
    let mut found = Line::default();
    let (code, comment) = text.split_at(code_end);
    if !comment.is_empty() {
        found.comments.push(comment[1..].trim());
    }
    let is_numbered = code.trim_start().starts_with(['N', 'n']);
    let body = body(code);
    // A text may have any character, and objects have outlines of any length.
    if is_text(body) {
        let code = if is_numbered {
            checked(code, line)?
        } else {
            code
        };
        found.words.extend(m_word(body));
        found.command = Some(self::body(code));
        return Ok(found);
    }
    if code_end > LINE_CHARS_MAX {
        return Err(refusal!(
            "line {line} is longer than {LINE_CHARS_MAX} characters: it is no G-code, or lost \
             its line ends"
        ));
    }
    let mut rest = self::body(checked(code, line)?);
    if rest.starts_with('%') {
        found.command = Some("%");
        return Ok(found);
    }
    if let Some(left) = program_number(rest) {
        rest = left;
    }
    while let Some(letter) = rest.bytes().next() {
        if letter == b'(' {
            let end = rest.find(')').ok_or_else(|| {
                refusal!("line {line}: the comment that begins with '(' has no ')'")
            })?;
            found.comments.push(rest[1..end].trim());
            rest = rest[end + 1..].trim_start();
            continue;
        }
        if !letter.is_ascii_alphabetic() {
            return Err(no_word(rest, line));
        }
        if found.words.is_empty() && is_text(rest) {
            found.command = Some(rest);
            return Ok(found);
        }
        let whole = rest;
        let (word, left) = word(rest, line)?;
        rest = left;
        if word.letter == b'N' && found.words.is_empty() {
            continue;
        }
        found.words.push(word);
        if takes_text(word) {
            found.command = Some(whole);
            return Ok(found);
        }
    }
    twice(&found.words, line)?;
    Ok(found)
}

/// A line without the block delete and the line number that may stand before it.
fn body(code: &str) -> &str {
    let code = code.trim().trim_start_matches('/').trim_start();
    let Some(number) = code.strip_prefix(['N', 'n']) else {
        return code;
    };
    let digits = number.trim_start();
    let behind = digits.trim_start_matches(|c: char| c.is_ascii_digit());
    match behind.len() < digits.len() {
        true => behind.trim_start(),
        false => code,
    }
}

/// A command whose parameters are any text.
fn is_text(body: &str) -> bool {
    is_macro(body) || m_word(body).is_some_and(takes_text)
}

/// The M with which a line begins.
fn m_word(body: &str) -> Option<Word> {
    let number = body.strip_prefix(['M', 'm'])?.trim_start();
    let end = number
        .find(|c: char| !c.is_ascii_digit())
        .unwrap_or(number.len());
    let value = number[..end].parse::<u32>().ok().map(f64::from)?;
    Some(Word {
        letter: b'M',
        value: Some(value),
    })
}

/// What follows the number of a program (`O1000`) that stands alone in its line.
fn program_number(body: &str) -> Option<&str> {
    let number = body.strip_prefix(['O', 'o'])?;
    let behind = number.trim_start_matches(|c: char| c.is_ascii_digit());
    let left = behind.trim_start();
    let is_alone = left.is_empty() || left.starts_with('(');
    (behind.len() < number.len() && is_alone).then_some(left)
}

/// A word and what follows it.
fn word(text: &str, line: usize) -> Result<(Word, &str), Refusal> {
    let letter = text.as_bytes()[0].to_ascii_uppercase();
    let after = text[1..].trim_start();
    if after.starts_with(['[', '#', '<', '=']) || letter == b'O' {
        return Err(error::computed(line));
    }
    if let Some(quoted) = after.strip_prefix('"') {
        let end = quoted.find('"').ok_or_else(|| no_word(text, line))?;
        let value = None;
        return Ok((Word { letter, value }, quoted[end + 1..].trim_start()));
    }
    let is_number = |c: char| c.is_ascii_digit() || matches!(c, '.' | '+' | '-');
    let end = after.find(|c| !is_number(c)).unwrap_or(after.len());
    let (number, rest) = after.split_at(end);
    let bad = || error::number(line, char::from(letter), &shortened(after));
    let value = match number {
        "" => None,
        _ if number.len() > NUMBER_CHARS_MAX => return Err(bad()),
        _ => Some(number.parse::<f64>().map_err(|_| bad())?),
    };
    let begins_word = |c: char| c.is_ascii_alphabetic() || c.is_whitespace() || c == '(';
    if !rest.is_empty() && !rest.starts_with(begins_word) {
        return Err(bad());
    }
    Ok((Word { letter, value }, rest.trim_start()))
}

/// Two letters in a row begin a name; what brackets or a percent sign hold is a comment.
fn is_macro(text: &str) -> bool {
    if text.starts_with(['(', '%']) {
        return false;
    }
    let second = text.as_bytes().get(1);
    second.is_some_and(|c| c.is_ascii_alphabetic() || *c == b'_')
}

/// Codes whose parameters are not those of motion, and may be any text.
fn takes_text(word: Word) -> bool {
    const READ: [u32; 42] = [
        0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 30, 48, 49, 66, 67, 68, 82, 83, 101, 103, 104, 106, 107, 108,
        109, 116, 120, 121, 140, 141, 190, 191, 200, 207, 208, 220, 221, 226, 227, 228, 568, 600,
    ];
    let number = word.value.filter(|value| *value >= 0.0);
    word.letter == b'M' && number.is_none_or(|value| !READ.contains(&(value as u32)))
}

/// The code without its checksum.
fn checked(code: &str, line: usize) -> Result<&str, Refusal> {
    // The last one: a text before it may have others.
    let behind = code.rfind(')').map_or(0, |close| close + 1);
    let star = code[behind..].rfind('*').map(|star| behind + star);
    let Some(star) = star else {
        return Ok(code);
    };
    let (code, given) = (&code[..star], &code[star + 1..]);
    let found = code.bytes().fold(0, |sum, byte| sum ^ byte);
    match given.trim().parse::<u8>() {
        Ok(given) if given == found => Ok(code),
        _ => Err(refusal!(
            "line {line}: its checksum is {given}, its text makes {found}: the file is damaged, \
             export it again",
            given = shortened(given)
        )),
    }
}

/// Parameters stand once; codes (G, M) may be several.
fn twice(words: &[Word], line: usize) -> Result<(), Refusal> {
    let mut seen = 0u32;
    for word in words
        .iter()
        .filter(|word| !matches!(word.letter, b'G' | b'M'))
    {
        let bit = 1 << (word.letter - b'A');
        if seen & bit != 0 {
            let letter = char::from(word.letter);
            return Err(refusal!(
                "line {line}: {letter} is given twice: divide the line"
            ));
        }
        seen |= bit;
    }
    Ok(())
}

fn no_word(text: &str, line: usize) -> Refusal {
    if text.starts_with(NOT_TEXT) {
        return refusal!(
            "line {line}: a word has bytes that are no text: save the G-code as plain UTF-8 \
             text"
        );
    }
    match text.starts_with(['#', '[', '$']) {
        true => error::computed(line),
        false => refusal!(
            "line {line}: '{text}' is no word of a letter and a number",
            text = shortened(text)
        ),
    }
}

#[cfg(test)]
mod tests {
    //! Goal: words, comments and frames of all dialects. Method: lines as they stand in files.
    use super::*;

    fn words(text: &str) -> String {
        let line = read_line(text, 1).expect(text);
        let words = line.words.iter().map(|word| match word.value {
            Some(value) => format!("{}{value}", char::from(word.letter)),
            None => format!("{}", char::from(word.letter)),
        });
        words.collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn words_of_all_dialects() {
        for (text, expected) in [
            (
                "G1 X118.957 Y86.043 E1.0205 ; perimeter",
                "G1 X118.957 Y86.043 E1.0205",
            ),
            ("g1x.5y-.25e1e5", ""),
            ("G1X.5Y-.25E1", "G1 X0.5 Y-0.25 E1"),
            ("N30 G0 X 10 (rapid) Y+3", "G0 X10 Y3"),
            ("G28 X Y", "G28 X Y"),
            ("%", ""),
            ("/G1 X1", "G1 X1"),
            ("N3 T0*57", "T0"),
            ("M117 Layer 3 of 9!", "M117"),
            ("M98 P\"start.g\"", "M98"),
        ] {
            if !expected.is_empty() || text == "%" {
                assert_eq!(words(text), expected, "{text}");
            }
        }
        let line = read_line("G1 (a) X1 (b) ; c", 1).expect("comments");
        assert_eq!(line.comments, ["c", "a", "b"]);
        for text in [
            "(rounded, tangential)",
            "N1 (rounded, tangential)",
            "(rounded, tangential) G1",
        ] {
            let line = read_line(text, 1).expect(text);
            assert_eq!(
                (line.command, &line.comments[..]),
                (None, &["rounded, tangential"][..])
            );
        }
        assert_eq!(read_line("%MM", 1).expect("a mark").command, Some("%"));
        let line = read_line("START_PRINT BED=60", 1).expect("macro");
        assert_eq!(line.command, Some("START_PRINT BED=60"));
    }

    #[test]
    fn what_is_no_line_is_refused() {
        for (text, part) in [
            ("G1 X1E5 E3", "E is given twice"),
            ("G1 X1.2.3", "no number"),
            ("G1 X1,5", "no number"),
            ("G1 X--5", "no number"),
            ("G1 X#5", "not computed"),
            ("#5=3", "not computed"),
            ("O100 sub", "not computed"),
            ("G1 (open X1", "no ')'"),
            ("N3 T0*58", "makes 57"),
            ("?", "no word"),
        ] {
            let error = read_line(text, 7).expect_err(text).to_string();
            assert!(
                error.contains(part) && error.contains("line 7"),
                "{text}: {error}"
            );
        }
    }
}
