//! The report's page: figures and pictures, plain HTML without scripts.

use super::figures::Figures;

const STYLE: &str = "body{font-family:system-ui,sans-serif;max-width:1320px;margin:2em auto;\
padding:0 1em;color:#1a202c}table{border-collapse:collapse;margin:0 2em 1em 0}\
td{padding:.15em .8em .15em 0}td+td{text-align:right;font-variant-numeric:tabular-nums}\
.groups{display:flex;flex-wrap:wrap}img{max-width:100%;border:1px solid #e2e8f0}\
h2{font-size:1.1em;margin:1.2em 0 .3em}";

/// The page. `pictures` are (file name, caption).
pub fn html(
    title: &str,
    figures: &Figures,
    notes: &[String],
    pictures: &[(String, String)],
) -> String {
    let title = escaped(title);
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <title>{title}</title><style>{STYLE}</style></head><body>\n<h1>{title}</h1>\n"
    );
    if !notes.is_empty() {
        page += "<ul>\n";
        for note in notes {
            page += &format!("<li>{}</li>\n", escaped(note));
        }
        page += "</ul>\n";
    }
    page += "<div class=\"groups\">\n";
    for (group, rows) in figures.groups() {
        page += &format!("<div><h2>{group}</h2><table>\n");
        for (what, value) in rows {
            page += &format!("<tr><td>{what}</td><td>{}</td></tr>\n", escaped(&value));
        }
        page += "</table></div>\n";
    }
    page += "</div>\n";
    for (file, caption) in pictures {
        page += &format!(
            "<h2>{caption}</h2>\n<a href=\"{file}\"><img src=\"{file}\" alt=\"{caption}\"></a>\n"
        );
    }
    page + "</body></html>\n"
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
