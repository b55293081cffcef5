//! Pages for browsers, each whole in itself: nothing is fetched but what is shown.

mod mesh;
mod report;

pub use self::report::{Chart, Document, is_page};

use serde_json::{Value, json};

/// What the viewer is made of: it makes its own elements within the one it is given.
const SCRIPT: &str = concat!(include_str!("meshopt.js"), include_str!("viewer.js"));
const STYLE: &str = include_str!("viewer.css");

/// A page that shows the tileset whose tree has this name, beside the page.
pub fn viewer(title: &str, tree: &str) -> String {
    let source = embedded(&json!({ "title": title, "tileset": tree }));
    let title = escaped(title);
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n\
         <link rel=\"icon\" href=\"data:,\">\n<title>{title}</title>\n<style>\nhtml,body{{margin:0;height:100%}}\n{STYLE}</style>\n<div id=\"viewer\" class=\"viewer\" style=\"height:100%\"></div>\n\
         <script>\n{SCRIPT}</script>\n<script>window.viewer = asraViewer(document.getElementById(\"viewer\"), {source});</script>\n</html>\n"
    )
}

/// Text as a page has it: no part of it is taken for an element, or ends an attribute.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            '\'' => out += "&#39;",
            c => out.push(c),
        }
    }
    out
}

/// A value as a script has it within a page: nothing in it ends the script.
fn embedded(value: &Value) -> String {
    value.to_string().replace('<', "\\u003c").replace('\u{2028}', "\\u2028").replace('\u{2029}', "\\u2029")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_are_text() {
        let name = "<script>alert(1)</script>\u{2028}&\"'.ply";
        let page = viewer(name, name);
        assert!(!page.contains("<script>alert") && !page.contains("alert(1)</script>"), "{page}");
        assert!(page.contains("<title>&lt;script&gt;alert(1)&lt;/script&gt;\u{2028}&amp;&quot;&#39;.ply</title>"));
        let (_, source) = page.split_once("getElementById(\"viewer\"), ").unwrap();
        let source: Value = serde_json::from_str(source.split_once(");</script>").unwrap().0).unwrap();
        assert_eq!(source, json!({ "title": name, "tileset": name }));
    }
}
