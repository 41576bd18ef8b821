//! The `headway` command.
