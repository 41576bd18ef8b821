//! `headway plan --shard K/N`: plans a share of a mesh's blocks into the folder of `--cache`, and writes no job.

use crate::api::{PlannedBlock, PlannedShard};
use crate::cli::args::PlanArgs;
use crate::cli::error::CliError;
use crate::cli::plan::planned::with_blocks;
use crate::cli::reading::part::ready;
use crate::cli::terminal::console::Console;
use crate::pipeline::piece::PieceCache;
use crate::pipeline::shards::Shard;
use serde_json::json;

pub(crate) fn run(args: &PlanArgs, console: &Console) -> Result<(), CliError> {
    let (Some(shard), Some(folder)) = (args.shard, &args.asked.place.cache) else {
        return Err(CliError::Usage(
            "--shard K/N and --cache DIR go together".to_string(),
        ));
    };
    let (ready, path) = ready(&args.input, &args.asked, console)?;
    let (planned, is_kept) = with_blocks(path, Some(folder), console, |blocks, bar| {
        let planned = ready.shard(shard, blocks, bar)?;
        Ok((planned, blocks.keeps()))
    })?;
    if !is_kept {
        return Err(CliError::Job(format!(
            "{}: the blocks could not be written to it",
            folder.display()
        )));
    }
    let text = match args.json {
        true => as_json(shard, &planned),
        false => as_text(shard, &planned),
    };
    console.result(&text)
}

fn as_json(shard: Shard, planned: &PlannedShard) -> String {
    let rows = planned.own.iter().map(|block| {
        json!({
            "block": block.number,
            "layers": block.layers,
            "was_planned": block.was_known,
        })
    });
    let all = json!({
        "shard": shard.number,
        "shards": shard.count,
        "blocks": planned.blocks,
        "own": rows.collect::<Vec<_>>(),
    });
    format!("{all}\n")
}

fn as_text(shard: Shard, planned: &PlannedShard) -> String {
    let row = |block: &PlannedBlock| {
        let what = match block.was_known {
            true => "was there",
            false => "planned",
        };
        let [first, last] = block.layers;
        format!("block {}: layers {first} to {last} {what}\n", block.number)
    };
    let rows: String = planned.own.iter().map(row).collect();
    format!(
        "{rows}shard {}/{}: {} of {} blocks\n",
        shard.number,
        shard.count,
        planned.own.len(),
        planned.blocks
    )
}
