//! The tests of the command itself, one program: a module a theme, in each a file a goal; [`rig`] runs the
//! command and gives it boards to talk to.

mod board;
mod output;
mod planning;
mod rig;
