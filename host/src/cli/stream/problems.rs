//! The log of a print, and failures that do not stop one: the page's server, the log.
//!
//! In: the state of both, in each iteration of the stream's loop. Out: messages for terminal and
//! page, each once.

use crate::cli::error::CliError;
use crate::cli::live::LivePrint;
use crate::cli::stream::resume_from::Resumed;
use crate::cli::terminal::output_file::OutputFile;
use crate::drive::link_log::LinkLog;
use crate::drive::log_place::UNWRITTEN;
use crate::drive::pump::Pump;
use crate::drive::synced_file::SyncedFile;
use headway_firmware::configuration::MachineConfiguration;

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

/// The requested log.
pub(super) fn log_file(
    log: Option<&OutputFile>,
    machine: &MachineConfiguration,
    resumed: Option<&Resumed>,
) -> Result<Option<LinkLog>, CliError> {
    let Some(path) = log.map(OutputFile::path) else {
        return Ok(None);
    };
    let file = SyncedFile::create(path, UNWRITTEN).map_err(|problem| CliError::File {
        path: path.display().to_string(),
        problem,
    })?;
    let mut log = LinkLog::new(Box::new(file), Some(machine));
    if let Some(rest) = resumed {
        log.remark(&rest.remark);
    }
    Ok(Some(log))
}
