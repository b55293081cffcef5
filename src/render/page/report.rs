//! A report as a page: figures, pictures, charts and the mesh, in one file that opens from a disk or a mail.
//!
//! All that comes from files or was typed is written as text ([`super::escaped`]); the page's policy forbids it to fetch anything.

use std::fmt::Write as _;
use std::io::{BufWriter, Write};

use base64::engine::general_purpose::STANDARD;
use base64::write::EncoderWriter;
use serde_json::{Map, Value};

use super::mesh::{PageMesh, least_memory};
use super::{SCRIPT, STYLE, embedded, escaped};
use crate::error::words::{short, thousands};
use crate::error::{Error, Result};
use crate::mesh::MeshSource;
use crate::render::{self, render};
use crate::resources::workers::Workers;
use crate::storage::atomic_file::AtomicFile;
use crate::storage::spool::Workspace;

const SHEET: &str = include_str!("report.css");
/// The page may show what is in it, and fetch nothing.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'";
/// What stands in every report's head, and in nothing else.
const MARK: &str = concat!("<meta name=\"generator\" content=\"asra-stream ", env!("CARGO_PKG_VERSION"));
/// The same of any version.
const MARK_OF_ANY: &[u8] = b"<meta name=\"generator\" content=\"asra-stream ";
/// Rows of a table of many like things.
const ROWS: usize = 24;

/// A report.
#[derive(Debug, Default)]
pub struct Document {
    /// What it is about, in a few words.
    pub title: String,
    /// What is told first, line by line.
    pub summary: String,
    /// What may be wrong: what it is, and what to do about it.
    pub warnings: Vec<String>,
    /// Pictures: what they show, and PNG.
    pub pictures: Vec<(String, Vec<u8>)>,
    /// Charts.
    pub charts: Vec<Chart>,
    /// What is told below the charts.
    pub remark: String,
    /// The mesh.
    pub mesh: Option<PageMesh>,
    /// Whether it is seen from both sides.
    pub sheet: bool,
    /// The attribute of vertices that it is coloured by at first; by default their own colours, or the height of what is seen from both sides.
    pub colour: Option<String>,
    /// Figures by section: its title, and an object.
    pub figures: Vec<(String, Value)>,
}

/// A chart of bars.
#[derive(Debug)]
pub enum Chart {
    /// How often values occur.
    Histogram {
        /// What is counted.
        title: String,
        /// From 0 to this, in parts of the same width.
        end: f64,
        /// What is in each part.
        counts: Vec<u64>,
        /// What is beyond the end.
        beyond: u64,
    },
    /// Things with names and a number each.
    Bars {
        /// What is told.
        title: String,
        /// Their unit, behind numbers.
        unit: &'static str,
        /// Names and numbers.
        bars: Vec<(String, f64)>,
    },
}

/// Whether a file is a report of this program, which a new one may replace, or empty.
pub fn is_page(head: &[u8]) -> bool {
    head.is_empty() || head.windows(MARK_OF_ANY.len()).any(|part| part == MARK_OF_ANY)
}

impl Document {
    /// The memory that [`Document::show`] needs, in bytes.
    pub fn least_memory(mesh: &dyn MeshSource, options: &render::Options) -> u64 {
        least_memory(mesh).max(render::least_memory(options))
    }

    /// Draws a mesh to whose places `origin` is to be added, and packs it, within `memory` bytes, of which there must be [`Document::least_memory`]. `progress` is told the part that is done.
    ///
    /// # Errors
    /// Those of drawing and of simplification.
    pub fn show(
        &mut self,
        (mesh, origin): (&dyn MeshSource, [f64; 3]),
        options: &render::Options,
        memory: u64,
        (workers, workspace): (&Workers, &Workspace),
        progress: &mut dyn FnMut(f64),
    ) -> Result<()> {
        let triangles = mesh.face_count().max(1) as f64;
        let told = &mut |done: u64| progress(0.2 * done as f64 / triangles);
        let picture = render(mesh, options, memory, workers, workspace, told)?;
        let names: Vec<&str> = options.views.iter().map(|view| view.name.as_str()).collect();
        let colours = match options.colour_by.of(mesh) {
            render::ColourBy::None => String::new(),
            by => format!(", coloured by {by}"),
        };
        self.pictures.push((format!("Seen from {}{colours}", names.join(" and ")), picture.png()));
        drop(picture);
        self.mesh = PageMesh::of(mesh, origin, memory, (workers, workspace), &mut |part| progress(0.2 + 0.8 * part))?;
        if self.mesh.is_none() && mesh.face_count() > 0 {
            self.remark += " The mesh is no manifold, and too large to be shown here.";
        }
        Ok(())
    }

    /// Writes it, and gives the file its name.
    ///
    /// # Errors
    /// [`Error::Io`]; those of [`AtomicFile::finish`].
    pub fn write(&self, file: AtomicFile) -> Result<()> {
        let path = file.path().to_path_buf();
        let put = || -> std::io::Result<()> {
            let mut out = BufWriter::new(file.file());
            self.put(&mut out)?;
            out.flush()
        };
        put().map_err(Error::io(path, "write the report"))?;
        file.finish()
    }

    fn put(&self, out: &mut impl Write) -> std::io::Result<()> {
        let title = escaped(&self.title);
        write!(
            out,
            "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
             <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n<link rel=\"icon\" href=\"data:,\">\n{MARK}\">\n<title>{title}</title>\n\
             <style>\n{SHEET}{STYLE}</style>\n<main>\n<h1>{title}</h1>\n<pre class=\"summary\">{}</pre>\n",
            escaped(&self.summary)
        )?;
        if !self.warnings.is_empty() {
            writeln!(out, "<section class=\"warnings\">\n<h2>What may be wrong</h2>\n<ul>")?;
            for warning in &self.warnings {
                writeln!(out, "<li>{}</li>", escaped(warning))?;
            }
            writeln!(out, "</ul>\n</section>")?;
        }
        if let Some(mesh) = &self.mesh {
            writeln!(
                out,
                "<section>\n<h2>The mesh</h2>\n<div id=\"viewer\" class=\"viewer shown\"></div>\n<p>{} Click into it, then the wheel zooms.</p>\n</section>",
                escaped(&mesh.words())
            )?;
        }
        for (words, png) in &self.pictures {
            write!(out, "<figure>\n<img alt=\"{}\" src=\"data:image/png;base64,", escaped(words))?;
            encoded(png, out)?;
            writeln!(out, "\">\n<figcaption>{}</figcaption>\n</figure>", escaped(words))?;
        }
        if !self.charts.is_empty() || !self.remark.is_empty() {
            writeln!(out, "<section class=\"charts\">")?;
            for chart in &self.charts {
                out.write_all(chart.drawn().as_bytes())?;
            }
            writeln!(out, "<p>{}</p>\n</section>", escaped(&self.remark))?;
        }
        for (title, figures) in &self.figures {
            let text = table(figures);
            if !text.is_empty() {
                writeln!(out, "<section>\n<h2>{}</h2>\n{text}</section>", escaped(title))?;
            }
        }
        writeln!(out, "</main>")?;
        if let Some(mesh) = &self.mesh {
            let mut source = mesh.source();
            source["title"] = Value::from(self.title.clone());
            source["mesh"] = Value::from("mesh");
            source["sheet"] = Value::from(self.sheet);
            source["colour"] = Value::from(self.colour.as_ref().map(|name| format!("_{}", name.to_uppercase())));
            write!(out, "<script type=\"text/plain\" id=\"mesh\">")?;
            encoded(&mesh.packed, out)?;
            writeln!(
                out,
                "</script>\n<script>\n{SCRIPT}</script>\n<script>window.viewer = asraViewer(document.getElementById(\"viewer\"), {});</script>",
                embedded(&source)
            )?;
        }
        writeln!(out, "</html>")
    }
}

/// Bytes as text.
fn encoded(bytes: &[u8], out: &mut impl Write) -> std::io::Result<()> {
    let mut encoder = EncoderWriter::new(out, &STANDARD);
    encoder.write_all(bytes)?;
    encoder.finish().map(drop)
}

/// A name as people read it.
fn spaced(name: &str) -> String {
    name.replace('_', " ")
}

/// A value in a cell; none if there is nothing to tell.
fn told(value: &Value) -> Option<String> {
    match value {
        Value::Null => None,
        Value::Bool(is) => Some(if *is { "yes" } else { "no" }.to_owned()),
        Value::Number(number) => match (number.as_u64(), number.as_f64()) {
            (Some(whole), _) => Some(thousands(whole)),
            (None, Some(value)) => Some(short(value)),
            _ => Some(number.to_string()),
        },
        Value::String(text) => Some(escaped(text)),
        Value::Array(list) => {
            let items: Vec<String> = list.iter().map(told).collect::<Option<_>>()?;
            Some(items.join(", ")).filter(|text| !text.is_empty())
        }
        Value::Object(_) => None,
    }
}

/// Figures as a table; those that are objects, or many, as tables in it.
fn table(value: &Value) -> String {
    let mut rows = String::new();
    match value {
        Value::Object(map) => {
            for (name, value) in map {
                let name = escaped(&spaced(name));
                let cell = told(value).unwrap_or_else(|| table(value));
                if !cell.is_empty() {
                    let _ = writeln!(rows, "<tr><th>{name}</th><td>{cell}</td></tr>");
                }
            }
        }
        Value::Array(list) => {
            let objects: Vec<&Map<String, Value>> = list.iter().filter_map(Value::as_object).collect();
            let Some(first) = objects.first() else {
                // Pairs, such as phases and their seconds.
                for item in list.iter().take(ROWS) {
                    if let Some(cell) = told(item) {
                        let _ = writeln!(rows, "<tr><td>{cell}</td></tr>");
                    }
                }
                return if rows.is_empty() { rows } else { format!("<table>\n{rows}</table>\n") };
            };
            let heads: String = first.keys().map(|name| format!("<th>{}</th>", escaped(&spaced(name)))).collect();
            let _ = writeln!(rows, "<tr>{heads}</tr>");
            for object in objects.iter().take(ROWS) {
                let cell = |name| {
                    object.get(name).map(|value| told(value).unwrap_or_else(|| table(value))).unwrap_or_default()
                };
                let cells: String = first.keys().map(|name| format!("<td>{}</td>", cell(name))).collect();
                let _ = writeln!(rows, "<tr>{cells}</tr>");
            }
            if objects.len() > ROWS {
                let _ = writeln!(rows, "<tr><td>and {} more</td></tr>", thousands((objects.len() - ROWS) as u64));
            }
        }
        _ => return told(value).unwrap_or_default(),
    }
    if rows.is_empty() { rows } else { format!("<table>\n{rows}</table>\n") }
}

/// Width and height of a chart's bars, in its own units.
const AREA: (f64, f64) = (600.0, 160.0);

impl Chart {
    /// As SVG, which shows its numbers where it is pointed at.
    fn drawn(&self) -> String {
        let mut out = String::new();
        let (width, height) = AREA;
        match self {
            Chart::Histogram { title, end, counts, beyond } => {
                let all = counts.iter().sum::<u64>() + beyond;
                let most = counts.iter().copied().max().unwrap_or(0).max(1) as f64;
                let _ = writeln!(
                    out,
                    "<figure class=\"chart\">\n<figcaption>{}</figcaption>\n<svg viewBox=\"0 -4 {width} {}\" role=\"img\" aria-label=\"{}\">",
                    escaped(title),
                    height + 30.0,
                    escaped(title)
                );
                let wide = width / counts.len().max(1) as f64;
                for (i, count) in counts.iter().enumerate() {
                    let high = height * *count as f64 / most;
                    let [from, to] = [i, i + 1].map(|i| short(end * i as f64 / counts.len() as f64));
                    let _ = writeln!(
                        out,
                        "<rect x=\"{:.2}\" y=\"{:.2}\" width=\"{:.2}\" height=\"{high:.2}\"><title>{from} to {to}: {}</title></rect>",
                        i as f64 * wide,
                        height - high,
                        (wide - 1.0).max(0.5),
                        thousands(*count)
                    );
                }
                let _ = writeln!(out, "<line x1=\"0\" y1=\"{height}\" x2=\"{width}\" y2=\"{height}\"/>");
                for part in 0..=4 {
                    let (x, anchor) =
                        (width * f64::from(part) / 4.0, ["start", "middle", "middle", "middle", "end"][part as usize]);
                    let _ = writeln!(
                        out,
                        "<text x=\"{x}\" y=\"{}\" text-anchor=\"{anchor}\">{}</text>",
                        height + 18.0,
                        short(end * f64::from(part) / 4.0)
                    );
                }
                let share = 100.0 * *beyond as f64 / all.max(1) as f64;
                let _ = writeln!(
                    out,
                    "</svg>\n<p>{} in all, {} ({}&nbsp;%) of them beyond {}.</p>\n</figure>",
                    thousands(all),
                    thousands(*beyond),
                    short(share),
                    short(*end)
                );
            }
            Chart::Bars { title, unit, bars } => {
                let most = bars.iter().map(|(_, number)| *number).fold(0.0, f64::max).max(f64::MIN_POSITIVE);
                let _ = writeln!(
                    out,
                    "<figure class=\"chart\">\n<figcaption>{}</figcaption>\n<table class=\"bars\">",
                    escaped(title)
                );
                for (name, number) in bars {
                    let told = if number.fract() == 0.0 { thousands(*number as u64) } else { short(*number) };
                    let share = 100.0 * number / most;
                    let name = escaped(&spaced(name));
                    let _ = writeln!(
                        out,
                        "<tr><th>{name}</th><td><i style=\"width:{share:.1}%\"></i></td><td>{told}{}</td></tr>",
                        escaped(unit)
                    );
                }
                let _ = writeln!(out, "</table>\n</figure>");
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn page(document: &Document) -> String {
        let mut out = Vec::new();
        document.put(&mut out).unwrap();
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn whatever_files_say_is_text() {
        let hostile = "</script><script>alert(1)</script>\"'><img src=x onerror=alert(2)>&";
        let figures = json!({ hostile: hostile, "list": [hostile], "rows": [{ hostile: hostile }], "deep": { "a": { "b": hostile } } });
        let text = page(&Document {
            title: hostile.into(),
            summary: hostile.into(),
            warnings: vec![hostile.into()],
            pictures: vec![(hostile.into(), vec![1, 2, 3])],
            charts: vec![
                Chart::Bars { title: hostile.into(), unit: "s", bars: vec![(hostile.into(), 1.5)] },
                Chart::Histogram { title: hostile.into(), end: 2.0, counts: vec![1, 2], beyond: 3 },
            ],
            remark: hostile.into(),
            mesh: None,
            sheet: false,
            colour: Some(hostile.into()),
            figures: vec![(hostile.into(), figures)],
        });
        assert!(
            !text.contains("<script") && !text.contains("<img src=x") && !text.contains("onerror=alert(2)>&\""),
            "{text}"
        );
        // Each of the places above has it at least once.
        assert!(text.matches("&lt;script&gt;alert(1)").count() >= 15, "{text}");
        assert_eq!(text.matches("<img ").count(), 1);
    }

    #[test]
    fn figures_are_tables_and_what_is_unknown_is_left_out() {
        let text = table(
            &json!({ "cell_size": 0.25, "count": 1234567, "none": null, "empty": [], "axis": "z", "raster": [1, 2, 3], "deep": { "a": null } }),
        );
        for part in
            ["<th>cell size</th><td>0.25</td>", "<th>axis</th><td>z</td>", "<td>1, 2, 3</td>", &thousands(1_234_567)]
        {
            assert!(text.contains(part), "{text}");
        }
        assert!(!text.contains("none") && !text.contains("empty") && !text.contains("deep"), "{text}");
        let many: Vec<Value> = (0..100).map(|i| json!({ "a": i })).collect();
        assert!(table(&json!(many)).contains("and 76 more"));
    }
}
