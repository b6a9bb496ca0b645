//! HTML pages that need no other file, while they grow: headings, tables, pictures.

use base::xml::escaped;

/// A page.
#[derive(Debug, Default)]
pub struct Page {
    text: String,
    /// True where tables scroll in a frame of their own.
    has_wide_tables: bool,
}

impl Page {
    /// Returns a page that begins with this HTML.
    pub fn begun(html: &str, has_wide_tables: bool) -> Self {
        let mut page = Self { text: String::new(), has_wide_tables };
        page.add(html);
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
        let frame = if self.has_wide_tables { "<div class=\"wide\">" } else { "" };
        self.add(&format!("{frame}<table><thead><tr>{}</tr></thead><tbody>", cells("th", heads)));
    }

    /// Adds a row.
    pub fn row<S: AsRef<str>>(&mut self, texts: &[S]) {
        self.add(&format!("<tr>{}</tr>", cells("td", texts)));
    }

    /// Ends a table.
    pub fn end_table(&mut self) {
        self.add(if self.has_wide_tables { "</tbody></table></div>" } else { "</tbody></table>" });
    }

    /// Adds an SVG that is drawn on white.
    pub fn picture(&mut self, svg: &str) {
        self.add(&format!("<div class=\"card\">{svg}</div>"));
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

fn cells<S: AsRef<str>>(kind: &str, texts: &[S]) -> String {
    texts.iter().map(|text| format!("<{kind}>{}</{kind}>", escaped(text.as_ref()))).collect()
}
