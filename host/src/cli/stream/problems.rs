//! Failures that do not stop a print: the page's server, the log.
//!
//! In: the state of both, in each iteration of the stream's loop. Out: messages for terminal and
//! page, each once.

use crate::cli::live::LivePrint;
use crate::drive::pump::Pump;

/// What has been reported.
#[derive(Debug, Default)]
pub(crate) struct Problems {
    /// Why the log is no longer written.
    pub log: Option<String>,
}

impl Problems {
    /// Reports new problems.
    pub(crate) fn look(&mut self, live: Option<&LivePrint>, pump: &Pump) -> Vec<String> {
        let server = live.and_then(LivePrint::server_problem).map(|problem| {
            format!(
                "the page's server has ended ({problem}); the print goes on, and takes `pause`, `abort` and `stop` \
                 at this terminal"
            )
        });
        let log = pump.log_problem().filter(|_| self.log.is_none());
        let log = log.map(|problem| {
            format!(
                "the log cannot be written any further ({problem}); the print goes on, but --resume-from cannot \
                 follow it from here: if power is lost, note the layer or pass"
            )
        });
        self.log = self.log.take().or_else(|| log.clone());
        server.into_iter().chain(log).collect()
    }
}
