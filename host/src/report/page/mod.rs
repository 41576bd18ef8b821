//! The report's page: one file with everything in it, which draws, plays and plots the job.
//!
//! ```text
//! Report --verdict (words), data (JSON), figures (tables)--> page.html with page.css and script/*.js
//! ```
//! It opens from disk and asks nothing of anybody: its own policy forbids requests. Without scripts
//! the figures stay, and the pictures beside it.

mod columns;
mod data;
mod ground;

use super::{Report, ReportFile, figures::Figures, verdict};

/// Says in a page who wrote it, by which a later report knows that it may be replaced.
pub const PAGE_GENERATOR: &str = r#"<meta name="generator" content="Headway">"#;
const TEMPLATE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");
/// The page's script, each part after those that it uses. PicoGL (MIT) draws in space by WebGL2.
const SCRIPTS: [&str; 11] = [
    include_str!("script/picogl.min.js"),
    include_str!("script/links.js"),
    include_str!("script/job.js"),
    include_str!("script/sweep.js"),
    include_str!("script/colours.js"),
    include_str!("script/view.js"),
    include_str!("script/flat.js"),
    include_str!("script/stack.js"),
    include_str!("script/panel.js"),
    include_str!("script/plots.js"),
    include_str!("script/page.js"),
];
/// The bar of a page that is served while it prints, and what fills it.
const LIVE_BAR: &str = include_str!("live.html");
const LIVE_SCRIPT: &str = include_str!("script/live.js");
/// Groups that a user reads first; the others are folded away.
const FIRST_GROUPS: [&str; 3] = ["Coverage", "Layers", "Motion"];

/// The page; `pictures` are those of the report's layers, which lie beside it.
pub fn html(report: &Report, pictures: &[ReportFile]) -> String {
    page(report, &files(report, pictures), ["", "", ""])
}

/// The page by itself, for who shows it inside of another: no file lies beside it.
pub fn inline_html(report: &Report) -> String {
    page(report, "", ["", "", ""])
}

/// The page as it is served while the job prints: with a bar that asks its own server and nobody else.
pub fn live_html(report: &Report) -> String {
    page(report, "", [";connect-src 'self'", LIVE_BAR, LIVE_SCRIPT])
}

fn page(report: &Report, files: &str, [policy, live, live_js]: [&str; 3]) -> String {
    let is_first = |group: &str| FIRST_GROUPS.contains(&group);
    let fields = [
        ("generator", PAGE_GENERATOR.to_string()),
        ("title", escaped(report.title)),
        ("css", STYLE.to_string()),
        ("verdict", escaped(&verdict::page_text(report.figures))),
        ("tiles", tiles(report.figures)),
        ("notes", notes(report.notes)),
        ("figures", tables(report.figures, is_first)),
        ("more", tables(report.figures, |group| !is_first(group))),
        ("files", files.to_string()),
        ("policy", policy.to_string()),
        ("live", live.to_string()),
        ("livejs", live_js.to_string()),
        ("data", data::json(report)),
        ("js", SCRIPTS.concat()),
    ];
    filled(TEMPLATE, &fields)
}

/// The template with each `{name}` replaced once; what is put in is not looked at again.
fn filled(template: &str, fields: &[(&str, String)]) -> String {
    let mut page = String::new();
    let mut rest = template;
    while let Some(start) = rest.find('{') {
        let (before, from) = rest.split_at(start);
        page += before;
        let named = fields.iter().find(|(name, _)| {
            from[1..]
                .strip_prefix(name)
                .is_some_and(|r| r.starts_with('}'))
        });
        match named {
            Some((name, text)) => {
                page += text;
                rest = &from[name.len() + 2..];
            }
            None => {
                page.push('{');
                rest = &from[1..];
            }
        }
    }
    page + rest
}

/// The figures that a user reads first, large.
fn tiles(figures: &Figures) -> String {
    let tiles: String = verdict::tiles(figures)
        .iter()
        .map(|(what, value)| format!("<div><dt>{what}</dt><dd>{}</dd></div>\n", escaped(value)))
        .collect();
    match tiles.as_str() {
        "" => tiles,
        _ => format!("<dl class=\"tiles\">\n{tiles}</dl>"),
    }
}

fn notes(notes: &[String]) -> String {
    if notes.is_empty() {
        return String::new();
    }
    let items: String = notes
        .iter()
        .map(|note| format!("<li>{}</li>\n", escaped(note)))
        .collect();
    format!(
        "<section class=\"card notes\" aria-label=\"Notes\"><h2>Notes</h2><ul>\n{items}</ul></section>"
    )
}

fn tables(figures: &Figures, wanted: impl Fn(&str) -> bool) -> String {
    let mut text = String::from("<div class=\"groups\">\n");
    for (group, rows) in figures.groups().into_iter().filter(|(g, _)| wanted(g)) {
        text += &format!("<div class=\"scroll\"><h2>{group}</h2><table>\n");
        for (what, value) in rows {
            let (what, value) = (escaped(&what), escaped(&value));
            text += &format!("<tr><td>{what}</td><td>{value}</td></tr>\n");
        }
        text += "</table></div>\n";
    }
    text + "</div>"
}

fn files(report: &Report, pictures: &[ReportFile]) -> String {
    let mut text = String::from(
        "<section class=\"card\" aria-label=\"Files\"><h2>Files beside this page</h2><ul>\n\
         <li><a href=\"report.json\">report.json</a>: all figures</li>\n",
    );
    for (ReportFile { name, .. }, layer) in pictures.iter().zip(&report.layers) {
        let of_layer = match layer.label {
            "" => String::new(),
            label => format!(": {}", escaped(label)),
        };
        text += &format!(
            "<li><a href=\"{name}\">{name}</a>: Outline, medial axis, passes and nozzle outlines{of_layer}</li>\n"
        );
    }
    text + "</ul></section>"
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
