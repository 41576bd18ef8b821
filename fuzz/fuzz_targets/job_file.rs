//! The job file reader, on arbitrary bytes and on files whose checksums are right.
#![no_main]

use headway::job::file;
use headway_fuzz::job::JobFile;
use libfuzzer_sys::fuzz_target;
use std::io::Cursor;

#[derive(arbitrary::Arbitrary, Debug)]
enum Input<'a> {
    Raw(&'a [u8]),
    Made(JobFile),
}

fuzz_target!(|input: Input| {
    let bytes = match input {
        Input::Raw(bytes) => bytes.to_vec(),
        Input::Made(file) => file.bytes(),
    };
    let summary = file::read_summary(&mut Cursor::new(&bytes));
    match file::read(&mut Cursor::new(&bytes)) {
        Ok(job) => {
            assert!(summary.is_ok());
            // What was read is written and read again as the same job.
            let mut again = Vec::new();
            file::write(&mut again, &job.header, &job.frames).expect("memory takes it");
            let read = file::read(&mut Cursor::new(&again)).expect("our own file");
            assert_eq!(read.frames, job.frames);
            let _ = job.stream();
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
