//! XML as used in a 3MF package: elements and their attributes by name, prefixes ignored.

use super::problem;
use crate::text::plain::plain;
use crate::text::refusal::Refusal;
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use std::borrow::Cow;
use std::io::BufRead;
use std::str::FromStr;

/// An element that begins.
pub(super) struct Tag<'a>(BytesStart<'a>);

/// What a text consists of.
pub(super) enum Part<'a> {
    /// An element begins.
    Open(Tag<'a>),
    /// An element ends.
    Close(Cow<'a, str>),
    /// Text between elements.
    Text(String),
}

impl Tag<'_> {
    /// Its name without a prefix.
    pub fn name(&self) -> Cow<'_, str> {
        String::from_utf8_lossy(self.0.local_name().into_inner())
    }

    /// An attribute by its name without a prefix.
    pub fn get(&self, name: &str) -> Option<String> {
        let mut all = self.0.attributes();
        let mut all = all.with_checks(false).flatten();
        let found = all.find(|a| a.key.local_name().as_ref() == name.as_bytes())?;
        // An entity that XML does not have stays as it is written.
        let value = found.unescape_value().map(|value| value.into_owned());
        Some(value.unwrap_or_else(|_| lossy(&found.value)))
    }

    /// Numbers of attributes, all in one scan: there are millions of these elements.
    pub fn numbers<const N: usize, T: FromStr + Copy + Default>(
        &self,
        names: [&str; N],
    ) -> Result<[T; N], Refusal> {
        let mut numbers = [None; N];
        for attribute in self.0.attributes().with_checks(false).flatten() {
            let key = attribute.key;
            if let Some(place) = names.iter().position(|n| n.as_bytes() == key.as_ref()) {
                let text = std::str::from_utf8(&attribute.value).ok();
                numbers[place] = text.and_then(|text| text.trim().parse().ok());
            }
        }
        let mut found = [T::default(); N];
        for ((found, number), name) in found.iter_mut().zip(numbers).zip(names) {
            *found = number.ok_or_else(|| self.no_number(name))?;
        }
        Ok(found)
    }

    /// An attribute that is a number.
    pub fn number<T: FromStr + Copy + Default>(&self, name: &str) -> Result<T, Refusal> {
        self.numbers([name]).map(|[number]| number)
    }

    fn no_number(&self, name: &str) -> Refusal {
        let given = self.get(name);
        let given = given.map_or("none".to_string(), |text| format!("`{text}`"));
        problem(&format!(
            "<{}> needs a number as {name} and has {given}",
            self.name()
        ))
    }

    /// Calls with the name of each attribute, without its prefix, and its value.
    pub fn for_attributes(&self, mut call: impl FnMut(&[u8], &[u8])) {
        for attribute in self.0.attributes().with_checks(false).flatten() {
            call(attribute.key.local_name().as_ref(), &attribute.value);
        }
    }
}

fn lossy(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Reads a text from its beginning to its end.
///
/// # Errors
/// What `take` says, and texts that are no XML or end within an element.
pub(super) fn read(
    text: impl BufRead,
    mut take: impl FnMut(Part) -> Result<(), Refusal>,
) -> Result<(), Refusal> {
    let mut text = text;
    let first = text
        .fill_buf()
        .map_err(|error| problem(&error.to_string()))?;
    // A 3MF's parts may be UTF-16 as well.
    if !matches!(plain(first.get(..4).unwrap_or_default()), Cow::Borrowed(_)) {
        let mut wide = Vec::new();
        let whole = text.read_to_end(&mut wide);
        whole.map_err(|error| problem(&error.to_string()))?;
        return read(&*plain(&wide), take);
    }
    let mut reader = Reader::from_reader(text);
    reader.config_mut().expand_empty_elements = true;
    let mut buffer = Vec::new();
    let mut depth = 0_usize;
    loop {
        buffer.clear();
        let event = reader.read_event_into(&mut buffer);
        match event.map_err(|error| problem(&error.to_string()))? {
            Event::Start(start) => {
                depth += 1;
                take(Part::Open(Tag(start)))?;
            }
            Event::End(end) => {
                depth = depth.saturating_sub(1);
                let name = end.local_name();
                take(Part::Close(String::from_utf8_lossy(name.into_inner())))?;
            }
            Event::Text(text) => {
                let is_blank = text.iter().all(u8::is_ascii_whitespace);
                if !is_blank {
                    let text = text.unescape().map(|text| text.into_owned());
                    take(Part::Text(text.unwrap_or_default()))?;
                }
            }
            Event::CData(data) => take(Part::Text(lossy(&data)))?,
            Event::Eof if depth > 0 => return Err(problem("its XML ends within an element")),
            Event::Eof => return Ok(()),
            _ => {}
        }
    }
}
