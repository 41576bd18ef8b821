//! Planned blocks of layers that are kept, and shares of a mesh's blocks that are planned on several machines.
//!
//! In: a mesh, machine and options as for a job, where blocks are kept ([`BlockStore`]). Out: blocks in the store, which
//! the job of the same mesh and options is then made of, byte for byte as without. Leaves out where they are kept.

use super::part::What;
use super::planning::{Step, Watched, plan_error, settings_of, sliced};
use super::{Error, Machine, Options, Part};
use crate::pipeline::mesh::FirstLayer;
use crate::pipeline::piece::{Piece, PieceCache};
use crate::pipeline::shards::{Shard, plan_shard as planned_shard};
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

/// A block of layers of a share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct PlannedBlock {
    /// From 1.
    pub number: usize,
    /// First and last layer, from 1.
    pub layers: [u32; 2],
    /// It was kept before.
    pub was_known: bool,
}

/// A planned share of a mesh's blocks.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct PlannedShard {
    /// The blocks of the share.
    pub own: Vec<PlannedBlock>,
    /// Number of the mesh's blocks.
    pub blocks: usize,
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
    let settings = settings_of(part, machine, options)?;
    let What::Mesh(loaded) = &part.what else {
        return Err(no_blocks());
    };
    check_cached(part, options)?;
    let (sliced, _) = sliced(loaded, options, &settings)?;
    let mut kept = KeptBlocks::new(cache.store);
    let watched = Watched::new(watch);
    let planned = planned_shard(
        &sliced,
        &part.keep_out,
        FirstLayer::default(),
        &settings,
        Shard { number, count },
        (&mut kept, cache.program),
        &watched,
    );
    if watched.has_stopped() {
        return Err(Error::Stopped);
    }
    let (own, blocks) = planned.map_err(plan_error)?;
    if !kept.keeps() {
        return Err(Error::Job(kept.notes.join("; ")));
    }
    let own = own.iter().map(|block| PlannedBlock {
        number: block.block + 1,
        layers: [block.layers.start + 1, block.layers.end],
        was_known: block.was_known,
    });
    Ok(PlannedShard {
        own: own.collect(),
        blocks,
    })
}

fn no_blocks() -> Error {
    Error::Options(
        "--cache goes with a mesh in flat layers: only it is planned in blocks".to_string(),
    )
}

/// Refuses kept blocks of what is not planned in blocks.
pub(super) fn check_cached(part: &Part, options: &Options) -> Result<(), Error> {
    let is_mesh = matches!(part.what, What::Mesh(_));
    match is_mesh && options.curved_layers.is_none() {
        true => Ok(()),
        false => Err(no_blocks()),
    }
}

/// Blocks in a store, read and written.
pub(super) struct KeptBlocks<'a> {
    store: Option<&'a mut dyn BlockStore>,
    /// Notes for the user.
    pub(super) notes: Vec<String>,
}

impl<'a> KeptBlocks<'a> {
    pub(super) fn new(store: &'a mut dyn BlockStore) -> KeptBlocks<'a> {
        KeptBlocks {
            store: Some(store),
            notes: Vec::new(),
        }
    }

    /// Nothing is kept.
    pub(super) fn none() -> KeptBlocks<'a> {
        KeptBlocks {
            store: None,
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
