//! Planned blocks of layers that are kept, and shares of a mesh's blocks that are planned on several machines.
//!
//! In: a mesh, machine and options as for a job, where blocks are kept ([`BlockStore`]). Out: blocks in the store, which
//! the job of the same mesh and options is then made of, byte for byte as without. Leaves out where they are kept.

use super::planning::{Step, Watched, ready};
use super::{Error, Machine, Options, Part};
use crate::pipeline::piece::{Piece, PieceCache};
use crate::pipeline::shards::{PlannedShard, Shard};
use std::ops::ControlFlow;

/// Where planned blocks of layers are kept, as bytes by name: a folder, an object store.
pub trait BlockStore {
    /// The block of this name (32 hexadecimal digits), if it is there.
    fn get(&mut self, name: &str) -> Option<Vec<u8>>;

    /// Keeps a block, completely or not at all.
    ///
    /// # Errors
    /// Why it cannot be kept; planning then goes on without the store, and the job's notes say so.
    fn put(&mut self, name: &str, block: &[u8]) -> Result<(), String>;
}

/// Kept blocks.
pub struct Cache<'a> {
    /// Where they are.
    pub store: &'a mut dyn BlockStore,
    /// The planning program, by what differs between builds of it (a hash of its file): blocks of another one are not
    /// used.
    pub program: &'a str,
}

/// Plans every `count`th block of a mesh's layers into the cache, from block `number` on (`[number, count]`, from 1), and
/// makes no job: on several machines at once. [`super::plan_cached`] with the same mesh and options then takes all
/// blocks from the cache. `watch` as in [`super::plan_watched`].
///
/// # Errors
/// [`Error::Options`] for a share that is none, and for a part that is no mesh in flat layers; those of
/// [`super::plan_watched`]; [`Error::Job`] where blocks could not be kept.
pub fn plan_shard(
    part: &Part,
    machine: &Machine,
    options: &Options,
    [number, count]: [usize; 2],
    cache: Cache,
    watch: &(dyn Fn(Step) -> ControlFlow<()> + Sync),
) -> Result<PlannedShard, Error> {
    if !(1..=count).contains(&number) {
        return Err(Error::Options(format!(
            "--shard {number}/{count}: give 1 to the number of shares, and that number"
        )));
    }
    let ready = ready(part, machine, options, true)?;
    let mut kept = KeptBlocks::of(Some(cache));
    let watched = Watched::new(watch);
    let planned = ready.shard(Shard { number, count }, &mut kept, &watched);
    let planned = watched.ended(planned)?;
    match kept.keeps() {
        true => Ok(planned),
        false => Err(Error::Job(kept.notes.join("; "))),
    }
}

/// Blocks in a store, read and written; without one nothing is kept.
pub(crate) struct KeptBlocks<'a> {
    store: Option<&'a mut dyn BlockStore>,
    /// The program whose blocks they are.
    pub(crate) program: &'a str,
    /// Notes for the user.
    pub(crate) notes: Vec<String>,
}

impl<'a> KeptBlocks<'a> {
    pub(crate) fn of(cache: Option<Cache<'a>>) -> KeptBlocks<'a> {
        let (store, program) = cache.map(|cache| (cache.store, cache.program)).unzip();
        KeptBlocks {
            store,
            program: program.unwrap_or_default(),
            notes: Vec::new(),
        }
    }
}

fn name_of(key: u128) -> String {
    format!("{key:032x}")
}

impl PieceCache for KeptBlocks<'_> {
    /// False as well after a block could not be kept.
    fn keeps(&self) -> bool {
        self.store.is_some()
    }

    fn get(&mut self, key: u128) -> Option<Piece> {
        let name = name_of(key);
        let bytes = self.store.as_mut()?.get(&name)?;
        let piece = Piece::from_bytes(&bytes);
        if piece.is_none() {
            self.notes.push(format!(
                "the kept block {name} is damaged: its layers are planned again"
            ));
        }
        piece
    }

    fn put(&mut self, key: u128, piece: &Piece) {
        let Some(store) = &mut self.store else {
            return;
        };
        let bytes = (piece.to_bytes()).ok_or_else(|| "a block cannot be packed".to_string());
        if let Err(why) = bytes.and_then(|bytes| store.put(&name_of(key), &bytes)) {
            self.notes
                .push(format!("blocks are no longer kept in --cache: {why}"));
            // Told once; planning does without.
            self.store = None;
        }
    }
}
