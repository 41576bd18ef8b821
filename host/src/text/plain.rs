//! The text of a file as its readers take it, however an editor or a program has saved it.

use std::borrow::Cow;

const UTF8_MARK: &[u8] = b"\xef\xbb\xbf";

/// UTF-8 without a byte order mark, in lines that end with LF or CR LF: UTF-16 is converted, and a CR alone
/// becomes an LF. Bytes that are no UTF-8 stay as they are.
pub fn plain(bytes: &[u8]) -> Cow<'_, [u8]> {
    let mut text = match utf16(bytes) {
        Some(text) => Cow::Owned(text.into_bytes()),
        None => Cow::Borrowed(bytes.strip_prefix(UTF8_MARK).unwrap_or(bytes)),
    };
    let is_alone = |text: &[u8], at: usize| text[at] == b'\r' && text.get(at + 1) != Some(&b'\n');
    if (0..text.len()).any(|at| is_alone(&text, at)) {
        let text = text.to_mut();
        for at in 0..text.len() {
            if is_alone(text, at) {
                text[at] = b'\n';
            }
        }
    }
    text
}

/// What UTF-16 says: by its mark, or by the zeros beside its first two characters.
fn utf16(bytes: &[u8]) -> Option<String> {
    let (is_little, text) = match bytes {
        [0xff, 0xfe, text @ ..] => (true, text),
        [0xfe, 0xff, text @ ..] => (false, text),
        [1..=255, 0, 1..=255, 0, ..] => (true, bytes),
        [0, 1..=255, 0, 1..=255, ..] => (false, bytes),
        _ => return None,
    };
    let unit = |two: &[u8]| match is_little {
        true => u16::from_le_bytes([two[0], two[1]]),
        false => u16::from_be_bytes([two[0], two[1]]),
    };
    let units: Vec<u16> = text.chunks_exact(2).map(unit).collect();
    Some(String::from_utf16_lossy(&units))
}

#[cfg(test)]
mod tests {
    //! Goal: one text, however it was saved. Method: two lines in every encoding and with every line end.
    use super::*;

    #[test]
    fn a_text_is_the_same_however_it_was_saved() {
        let text = "v 1 0\n# ä\n";
        let wide = |text: &str, to: fn(u16) -> [u8; 2]| -> Vec<u8> {
            text.encode_utf16().flat_map(to).collect()
        };
        let marked = format!("\u{feff}{text}");
        for bytes in [
            text.as_bytes().to_vec(),
            marked.clone().into_bytes(),
            text.replace('\n', "\r").into_bytes(),
            wide(&marked, u16::to_le_bytes),
            wide(&marked.replace('\n', "\r"), u16::to_be_bytes),
            wide(text, u16::to_le_bytes),
            wide(text, u16::to_be_bytes),
        ] {
            assert_eq!(plain(&bytes), text.as_bytes(), "{bytes:?}");
        }
        let windows = text.replace('\n', "\r\n").into_bytes();
        assert!(matches!(plain(&windows), Cow::Borrowed(kept) if kept == windows));
        // No text in UTF-8: the reader tells where.
        assert_eq!(plain(b"\xff\xff").as_ref(), b"\xff\xff");
    }
}
