//! The reader of conversation logs: no panic, times in order, an error that can be printed.
#![no_main]

use headway::drive::link_log::{Entry, read_log};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    // The head is right in every other case, so that what follows it is reached.
    let mut text = match bytes.first() {
        Some(first) if first & 1 == 1 => b"# headway link log 1\n".to_vec(),
        _ => Vec::new(),
    };
    text.extend_from_slice(bytes);
    match read_log(&mut text.as_slice()) {
        Ok(log) => {
            let times = log.entries.iter().map(|entry| match entry {
                Entry::Bytes { at_us, .. } | Entry::Event { at_us, .. } => *at_us,
            });
            assert!(times.is_sorted());
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
