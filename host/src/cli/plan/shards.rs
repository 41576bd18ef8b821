//! `headway plan --shard K/N`: plans a share of a mesh's blocks into the folder of `--cache`, and writes no job.

use crate::cli::args::PlanArgs;
use crate::cli::error::CliError;
use crate::cli::plan::piece_cache::{CacheFolder, program};
use crate::cli::plan::planned::{check_options, placed_settings, plan_error};
use crate::cli::plan::planned_part::sliced;
use crate::cli::reading::load;
use crate::cli::terminal::console::Console;
use crate::input::Input;
use crate::pipeline::piece::PieceCache;
use crate::pipeline::shards::{Shard, ShardBlock, plan_shard};
use serde_json::json;

pub(crate) fn run(args: &PlanArgs, console: &Console) -> Result<(), CliError> {
    let (Some(shard), Some(folder)) = (args.shard, &args.place.cache) else {
        return Err(CliError::Usage(
            "--shard K/N and --cache DIR go together".to_string(),
        ));
    };
    let (path, place) = (&args.input, &args.place);
    let settings = placed_settings(place, &args.settings)?;
    let no_blocks = || {
        CliError::Usage(
            "--shard goes with a mesh in flat layers: only it is planned in blocks".to_string(),
        )
    };
    if place.surface.is_some() || place.curved_layers.is_some() {
        return Err(no_blocks());
    }
    let input = load::input(path, &args.reading, &settings, console)?;
    check_options(&input, place, &args.settings)?;
    let keep_out = load::keep_out(place.keep_out.as_deref(), &args.reading, &settings, console)?;
    let Input::Mesh(loaded) = input else {
        return Err(no_blocks());
    };
    let (part, first) = sliced(path, &loaded, place, &settings, console)?;
    let mut cache = CacheFolder::open(Some(folder))?;
    let bar = console.planning();
    let planned = plan_shard(
        &part,
        &keep_out,
        first,
        &settings,
        shard,
        (&mut cache, &program()),
        &bar,
    );
    bar.clear();
    console.notes(&cache.notes);
    let (blocks, count) = planned.map_err(|error| plan_error(path, &error))?;
    if !cache.keeps() {
        return Err(CliError::Job(format!(
            "{}: the blocks could not be written to it",
            folder.display()
        )));
    }
    let text = match args.json {
        true => as_json(shard, &blocks, count),
        false => as_text(shard, &blocks, count),
    };
    console.result(&text)
}

fn as_json(shard: Shard, blocks: &[ShardBlock], count: usize) -> String {
    let rows = blocks.iter().map(|block| {
        json!({
            "block": block.block + 1,
            "layers": [block.layers.start + 1, block.layers.end],
            "was_planned": block.was_known,
        })
    });
    let all = json!({
        "shard": shard.number,
        "shards": shard.count,
        "blocks": count,
        "own": rows.collect::<Vec<_>>(),
    });
    format!("{all}\n")
}

fn as_text(shard: Shard, blocks: &[ShardBlock], count: usize) -> String {
    let row = |block: &ShardBlock| {
        let what = match block.was_known {
            true => "was there",
            false => "planned",
        };
        let (number, layers) = (block.block + 1, &block.layers);
        format!(
            "block {number}: layers {} to {} {what}\n",
            layers.start + 1,
            layers.end
        )
    };
    let rows: String = blocks.iter().map(row).collect();
    let Shard { number, count: of } = shard;
    format!(
        "{rows}shard {number}/{of}: {} of {count} blocks\n",
        blocks.len()
    )
}
