//! One key of a machine file set anew, everything else as it was written.
//!
//! In: the file's text, a group, a key and its value as TOML. Out: the text, comments and order kept; the result is read
//! again and must be the old file with that key alone changed. Leaves out groups that are written as inline tables or with
//! dotted keys: those are refused, with the line to write by hand.

use crate::text::refusal::{Refusal, refusal};
use toml::{Table, Value};

/// The text with `key = value` in `[group]`.
///
/// # Errors
/// What cannot be placed, and the line to write by hand.
pub fn with_key(text: &str, group: &str, key: &str, value: &str) -> Result<String, Refusal> {
    let by_hand = || {
        refusal!(
            "the file's [{group}] is not laid out as usual: write `{key} = {value}` into it by hand"
        )
    };
    let wanted = (|| {
        let mut wanted: Table = text.parse().ok()?;
        let line: Table = format!("{key} = {value}").parse().ok()?;
        let of_group = wanted
            .entry(group)
            .or_insert_with(|| Value::Table(Table::new()));
        of_group.as_table_mut()?.extend(line);
        Some(wanted)
    })();
    let placed = placed(text, group, key, value);
    let is_right = placed
        .parse::<Table>()
        .is_ok_and(|table| Some(table) == wanted);
    if is_right { Ok(placed) } else { Err(by_hand()) }
}

fn placed(text: &str, group: &str, key: &str, value: &str) -> String {
    let mut lines: Vec<String> = text.lines().map(str::to_string).collect();
    let bare = |line: &str| {
        line.split('#')
            .next()
            .unwrap_or_default()
            .trim()
            .to_string()
    };
    let written = format!("{key} = {value}");
    let Some(head) = lines
        .iter()
        .position(|line| bare(line) == format!("[{group}]"))
    else {
        return format!("{}\n\n[{group}]\n{written}\n", text.trim_end());
    };
    // Rows of an array begin with a bracket too, but not with a name behind it.
    let is_head = |line: &String| {
        let name = line.trim_start().strip_prefix('[');
        name.is_some_and(|name| name.starts_with(|c: char| c.is_alphabetic() || "_\"[".contains(c)))
    };
    let end = lines.iter().skip(head + 1).position(is_head);
    let end = end.map_or(lines.len(), |end| end + head + 1);
    let is_key = |line: &str| {
        let given = line.trim_start().strip_prefix(key);
        given.is_some_and(|rest| rest.trim_start().starts_with('='))
    };
    let old = lines[head + 1..end].iter().position(|line| is_key(line));
    match old.map(|old| old + head + 1) {
        // An array may go over several lines.
        Some(old) => {
            let open = |lines: &[String]| {
                let text: String = lines.iter().map(|line| bare(line)).collect();
                text.matches('[').count() > text.matches(']').count()
            };
            let rest = (old..lines.len()).find(|last| !open(&lines[old..=*last]));
            let last = rest.unwrap_or(old);
            let comment = lines[last]
                .find('#')
                .map(|at| format!(" {}", &lines[last][at..]));
            lines.splice(old..=last, [written + &comment.unwrap_or_default()]);
        }
        None => {
            let is_filled = |(_, line): &(usize, &String)| !line.trim().is_empty();
            let last = lines.iter().enumerate().take(end).rfind(is_filled);
            lines.insert(last.map_or(end, |(last, _)| last + 1), written);
        }
    }
    lines.join("\n") + "\n"
}

#[cfg(test)]
mod tests {
    //! Goal: a key is set where it belongs and nothing else changes. Method: files with the key, without, over several
    //! lines, without the group, and laid out otherwise.
    use super::*;

    const FILE: &str = "# mine\nname = \"a\"\n\n[extruder] # geared\nsteps_per_mm3 = 400 # measured\nflow_loss = [\n  \
                        [1, 0.1], # old\n  [2, 0.2],\n] # to do\n\n[print]\nspeed_mm_s = 50\n";

    #[test]
    fn one_key_changes_and_comments_stay() {
        let text = with_key(FILE, "extruder", "flow_loss", "[[3, 0.3]]").expect("placed");
        let expected = FILE.replace(
            "[\n  [1, 0.1], # old\n  [2, 0.2],\n] # to do",
            "[[3, 0.3]] # to do",
        );
        assert_eq!(text, expected);
        let text = with_key(FILE, "extruder", "steps_per_mm3", "410").expect("placed");
        assert_eq!(text, FILE.replace("400", "410"));
        let text = with_key(FILE, "extruder", "new", "1").expect("placed");
        assert_eq!(text, FILE.replace("] # to do\n", "] # to do\nnew = 1\n"));
        let text = with_key(FILE, "flow", "prime_mm3", "0.5").expect("placed");
        assert_eq!(text, format!("{FILE}\n[flow]\nprime_mm3 = 0.5\n"));
        let text = with_key(FILE, "print", "lift_mm", "1").expect("placed");
        assert_eq!(text, format!("{FILE}lift_mm = 1\n"));
    }

    #[test]
    fn what_is_laid_out_otherwise_is_refused() {
        for file in [
            "extruder = { steps_per_mm3 = 400 }\n",
            "extruder.steps_per_mm3 = 400\n",
            "text = \"\"\"\n[extruder]\n\"\"\"\n",
            "no toml",
        ] {
            let refused = with_key(file, "extruder", "flow_loss", "[[3, 0.3]]").expect_err(file);
            assert!(
                refused.to_string().contains("flow_loss = [[3, 0.3]]"),
                "{file}"
            );
        }
    }
}
