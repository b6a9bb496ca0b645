//! HTML pages that need no other file, while they grow: headings, tables, pictures.

use base::xml::escaped;

/// How every page looks, in light and dark and on paper.
const STYLE: &str = ":root{color-scheme:light dark;--ink:#222;--paper:#fff;--line:#d9d9d9;--head:#f3f3f3;--mark:#0072b2;--small:#555}\
@media(prefers-color-scheme:dark){:root{--ink:#e6e6e6;--paper:#16181b;--line:#3a3e44;--head:#22262b;--mark:#56b4e9;--small:#aaa}}\
body{font:15px/1.45 Helvetica,Arial,'DejaVu Sans',sans-serif;color:var(--ink);background:var(--paper);max-width:72em;margin:1.2em auto;padding:0 1em}\
h1{font-size:1.2em;padding:.6em .8em;border-radius:4px;color:#fff;overflow-wrap:anywhere}.met{background:#00694e}.open{background:#7a5a00}.broken{background:#a83a00}\
h2{font-size:1.05em;margin:1.6em 0 .3em;border-bottom:1px solid var(--line)}.wide{overflow-x:auto}\
table{border-collapse:collapse;font-size:.86em;margin:.4em 0}th,td{text-align:left;padding:.2em .7em;border-bottom:1px solid var(--line);vertical-align:top;overflow-wrap:anywhere}\
th{background:var(--head)}td.n{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}tr.bad td{background:#fff1ea;color:#222}tr.open td{background:#fff8dc;color:#222}\
.how{display:block;color:var(--small);min-width:20em;max-width:44em}td.sign{min-width:14em;height:2.2em}\
svg{max-width:100%;height:auto;margin:.6em 0}.card{background:#fff;display:inline-block;max-width:100%}\
svg.line{width:760px;font-size:12px;fill:var(--ink)}svg.line .mark{stroke:var(--mark);stroke-width:4;fill:none}svg.line .axis{stroke:var(--ink)}\
img{max-width:100%}figure{display:inline-block;vertical-align:top;margin:.4em 1em .4em 0;max-width:18em}figure img{image-rendering:pixelated;max-width:100%;border:1px solid var(--line)}figcaption{font-size:.8em}\
@media print{@page{margin:14mm}:root{color-scheme:light;--ink:#222;--paper:#fff;--line:#d9d9d9;--head:#f3f3f3;--small:#555}body{max-width:none;margin:0;padding:0;font-size:11px}\
.wide{overflow:visible}table{width:100%}th,td{padding:.15em .4em;overflow-wrap:break-word}td:last-child{overflow-wrap:anywhere;min-width:6em}.how,td.sign{min-width:0}thead{display:table-header-group}tr,img,figure,svg,.card{break-inside:avoid}\
h1,tr.bad td,tr.open td{print-color-adjust:exact;-webkit-print-color-adjust:exact}h2{break-after:avoid}}";

/// A page.
#[derive(Debug, Default)]
pub struct Page {
    text: String,
}

impl Page {
    /// Returns a page that begins with a verdict: its first line has it as title, its first words are the heading, whose
    /// colour follows from `class`: met, open or broken. `head` is more of the document's head.
    pub fn begun(verdict: &str, class: &str, head: &str) -> Self {
        let verdict = escaped(verdict);
        let mut page = Self::default();
        page.add(&format!(
            "<!DOCTYPE html><html lang=\"en\"><head><meta charset=\"utf-8\"><title>{verdict}</title>\n\
             <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n{head}<style>{STYLE}</style></head>\n\
             <body><h1 class=\"{class}\">{verdict}</h1>"
        ));
        page
    }

    /// Returns the whole text.
    pub fn end(mut self) -> String {
        self.add("</body></html>");
        self.text
    }

    /// Adds HTML as it is.
    pub fn add(&mut self, html: &str) {
        self.text.push_str(html);
        self.text.push('\n');
    }

    /// Adds a heading.
    pub fn heading(&mut self, text: &str) {
        self.add(&format!("<h2>{}</h2>", escaped(text)));
    }

    /// Adds a paragraph.
    pub fn paragraph(&mut self, text: &str) {
        self.add(&format!("<p>{}</p>", escaped(text)));
    }

    /// Begins a table with its heads.
    pub fn table(&mut self, heads: &[&str]) {
        self.add(&format!("<div class=\"wide\"><table><thead><tr>{}</tr></thead><tbody>", cells("th", heads)));
    }

    /// Adds a row.
    pub fn row<S: AsRef<str>>(&mut self, texts: &[S]) {
        self.row_of("", texts);
    }

    /// Adds a row of a class: bad or open.
    pub fn row_of<S: AsRef<str>>(&mut self, class: &str, texts: &[S]) {
        let class = if class.is_empty() { String::new() } else { format!(" class=\"{class}\"") };
        self.add(&format!("<tr{class}>{}</tr>", cells("td", texts)));
    }

    /// Ends a table.
    pub fn end_table(&mut self) {
        self.add("</tbody></table></div>");
    }

    /// Adds a table of values with their names.
    pub fn values<S: AsRef<str>>(&mut self, rows: impl IntoIterator<Item = (S, String)>) {
        self.table(&["what", "value"]);
        rows.into_iter().for_each(|(what, value)| self.row(&[what.as_ref(), &value]));
        self.end_table();
    }

    /// Adds an SVG that is drawn on white.
    pub fn picture(&mut self, svg: &str) {
        self.add(&format!("<div class=\"card\">{svg}</div>"));
    }

    /// Adds a PNG, in Base64, as wide as the page.
    pub fn wide_image(&mut self, png: &str, what: &str) {
        self.add(&format!("<p><img alt=\"{}\" src=\"data:image/png;base64,{png}\"></p>", escaped(what)));
    }

    /// Adds a PNG, in Base64, with its caption.
    pub fn image(&mut self, png: &str, [width, height]: [usize; 2], caption: &str) {
        let caption = escaped(caption);
        self.add(&format!(
            "<figure><img alt=\"{caption}\" width=\"{width}\" height=\"{height}\" src=\"data:image/png;base64,{png}\">\
             <figcaption>{caption}</figcaption></figure>"
        ));
    }
}

/// Returns the cells of a row; numbers are on the right.
fn cells<S: AsRef<str>>(kind: &str, texts: &[S]) -> String {
    let cell = |text: &S| {
        let class = if text.as_ref().parse::<f64>().is_ok() { " class=\"n\"" } else { "" };
        format!("<{kind}{class}>{}</{kind}>", escaped(text.as_ref()))
    };
    texts.iter().map(cell).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_text_is_markup_wherever_it_comes_from() {
        const HOSTILE: &str = "<b a=\"1\">&";
        let mut page = Page::begun(HOSTILE, "met", "");
        page.heading(HOSTILE);
        page.paragraph(HOSTILE);
        page.table(&[HOSTILE]);
        page.row(&[HOSTILE]);
        page.end_table();
        page.values([(HOSTILE, HOSTILE.to_owned())]);
        page.wide_image("AA==", HOSTILE);
        page.image("AA==", [1, 1], HOSTILE);
        let html = page.end();
        // Title and heading of the page; heading, paragraph, head, cell, both of a value; twice in pictures' texts, and a caption.
        assert_eq!(html.matches("&lt;b a=&quot;1&quot;&gt;&amp;").count(), 11, "{html}");
        assert!(!html.contains("<b a") && !html.contains("&amp;lt;"), "{html}");
        assert!(html.ends_with("</body></html>\n"));
    }

    #[test]
    fn numbers_are_on_the_right() {
        let mut page = Page::default();
        page.row(&["1.5", "star"]);
        assert_eq!(page.end(), "<tr><td class=\"n\">1.5</td><td>star</td></tr>\n</body></html>\n");
    }
}
