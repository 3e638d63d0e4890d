//! The document as HTML: what is read, without style sheet and scripts.

use maud::{html, Markup, PreEscaped};
use modlens_protocol::visible::visible;
use serde_json::Value as Json;

use crate::causes::{causes, verdict, Card, URGENT};
use crate::examples::{examples, Example, Frame};
use crate::layout::{sections, text};
use crate::rows::rows_at;
use crate::tables::Table;
use crate::texts::fixed;

/// The end of a line: a page can be looked at and compared line by line.
const LINE: PreEscaped<&str> = PreEscaped("\n");

/// The title of the page of a document as HTML.
pub fn title(document: &Json) -> String {
    html! { (summary(document, "name")) ": Modbus report" }.into_string()
}

/// The sections of a document as HTML: name and verdict, the causes, those of the layout; then the appendix.
pub fn body(document: &Json) -> String {
    let causes = causes(document);
    let (urgent, more) = causes.split_at(causes.len().min(URGENT));
    let markup = html! {
        (header(document)) (LINE)
        section id="diagnoses" {
            h2 { "What to do first" }
            @for (at, card) in urgent.iter().enumerate() { (cause(at + 1, card)) }
            @if urgent.is_empty() { p.empty { "No cause of trouble was found." } }
            @if !more.is_empty() { p.more { a href="#more-causes" { (more.len()) " more in the appendix" } } }
        }
        (LINE)
        p.basis { "Based on " (summary(document, "sources")) "." } (LINE)
        @for one in sections().iter().filter(|one| is_shown(document, one)) {
            @if one["appendix"] == true {
                h2.part { "Appendix" } (LINE)
                @if !more.is_empty() {
                    section id="more-causes" {
                        h2 { "More causes" }
                        @for (at, card) in more.iter().enumerate() { (cause(URGENT + at + 1, card)) }
                    }
                    (LINE)
                }
            }
            (section(document, one)) (LINE)
        }
    };
    markup.into_string()
}

/// Name, period or sources; a document from elsewhere may have none.
fn summary(document: &Json, key: &str) -> String {
    visible(text(&document["summary"][key]))
}

fn header(document: &Json) -> Markup {
    let (word, shown) = verdict(document);
    html! {
        header {
            h1 { (summary(document, "name")) }
            p.period { (summary(document, "period")) }
            p class={ "verdict " (word) } { strong { (shown) } " " (visible(text(&document["doctor"]["sentence"]))) }
        }
    }
}

fn cause(number: usize, card: &Card) -> Markup {
    html! {
        article class={ "card " (card.level) } {
            h3 { span.level { (card.level) } " " (number) ". " (card.title) " " code { (card.code) } }
            @for (head, text) in &card.texts {
                p { @if !head.is_empty() { strong { (head) ":" } " " } (text) }
            }
            dl {
                @for (name, value) in &card.facts { div { dt { (name) } dd { (value) } } }
                @if !card.examples.is_empty() {
                    div {
                        dt { "example transactions" }
                        dd {
                            @for (at, txn) in card.examples.iter().enumerate() {
                                @if at > 0 { ", " }
                                a href={ "#txn-" (txn) } { (txn) }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Optional sections are shown where they have a row, or where there is one at the path that they name.
fn is_shown(document: &Json, section: &Json) -> bool {
    match &section["optional"] {
        Json::Bool(true) => has_rows(document, section),
        Json::String(path) => !rows_at(document, path).is_empty(),
        _ => true,
    }
}

fn has_rows(document: &Json, section: &Json) -> bool {
    !rows_at(document, text(&section["rows"])).is_empty()
}

fn section(document: &Json, one: &Json) -> Markup {
    let id = text(&one["id"]);
    html! {
        section id=(id) {
            h2 { (text(&one["title"])) }
            @if has_rows(document, one) {
                @if let Some(text) = one["text"].as_str() { p { (text) } }
                @if let Some(hint) = one["hint"].as_str() { p class="hint script-only" { (hint) } }
                (place_of_plots(one))
                @if let Some(legend) = one["legend"].as_array() { (colours(legend)) }
                (content(document, one))
            } @else {
                (place_of_plots(one))
                p.empty { (text(&one["empty"])) }
            }
        }
    }
}

fn place_of_plots(section: &Json) -> Markup {
    html! {
        @if !section["draw"].is_null() || !section["plots"].is_null() {
            div class="plot script-only" data-plot=(text(&section["id"])) {}
        }
    }
}

fn colours(legend: &[Json]) -> Markup {
    html! {
        p class="legend script-only" {
            @for one in legend { span { i class={ "swatch " (text(&one[0])) } {} (text(&one[1])) } }
        }
    }
}

fn content(document: &Json, section: &Json) -> Markup {
    if section["examples"] == true {
        return html! { @for one in examples(document) { (example(&one)) } };
    }
    let found = Table::of(document, section);
    html! {
        (table(text(&section["title"]), &found))
        @if found.more > 0 { p.more { (fixed(found.more as f64, 0)) " more are in the document." } }
    }
}

fn table(title: &str, found: &Table) -> Markup {
    html! {
        div.scroll tabindex="0" role="region" aria-label=(title) {
            table {
                thead {
                    tr { @for (at, name) in found.head.iter().enumerate() { th scope="col" class=[found.drawn[at].then_some("script-only")] { (name) } } }
                }
                tbody {
                    @for row in &found.rows {
                        tr { @for (at, text) in row.iter().enumerate() { td class=[class(found, at)] { (content_of(found, at, text)) } } }
                    }
                }
            }
        }
    }
}

/// A text, or the picture that it outlines: 120 wide, 16 high, a path for each colour.
fn content_of(table: &Table, column: usize, text: &str) -> Markup {
    html! {
        @if table.strips[column] && !text.is_empty() {
            svg.strip viewBox="0 0 120 16" width="120" height="16" aria-hidden="true" {
                @for (at, outline) in text.split('|').enumerate() { path class={ "c" (at) } d=(outline) {} }
            }
        } @else {
            (text)
        }
    }
}

fn class(table: &Table, column: usize) -> Option<&'static str> {
    match (table.right[column], table.drawn[column]) {
        (true, _) => Some("n"),
        (_, true) => Some("script-only"),
        _ => None,
    }
}

fn example(one: &Example) -> Markup {
    html! {
        details.example.named[one.is_named] id={ "txn-" (one.txn) } {
            summary { (one.title) }
            @if !one.findings.is_empty() { p { (one.findings) } }
            @for found in &one.frames { (frame(found)) }
        }
    }
}

fn frame(found: &Frame) -> Markup {
    html! {
        div.scroll {
            table.bytes {
                caption { (found.title) }
                thead { tr { @for name in ["offset", "bytes", "field", "value", "meaning"] { th scope="col" { (name) } } } }
                tbody {
                    @for (cells, is_wrong) in &found.rows {
                        tr class=[is_wrong.then_some("wrong")] { @for text in cells { td { (text) } } }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::layout::list;

    #[test]
    fn texts_of_the_document_are_no_html() {
        let hostile = "</p><script>alert(1)</script>\u{202e}";
        let document = json!({
            "summary": {"name": hostile, "period": hostile, "sources": hostile},
            "doctor": {"verdict": hostile, "sentence": hostile, "diagnoses": [{"severity": hostile, "title": hostile, "unit": 1}]},
            "sources": [{"name": hostile}],
        });
        let html = body(&document);
        assert!(!html.contains("<script") && !html.contains('\u{202e}'), "{html}");
        assert!(html.contains("&lt;/p&gt;&lt;script&gt;alert(1)&lt;/script&gt;\\u202e"));
        assert!(html.contains("class=\"verdict unknown\"><strong>not enough to judge"));
    }

    #[test]
    fn an_empty_document_says_that_nothing_was_found() {
        for document in [json!({}), json!(null), json!([1]), json!({"doctor": 1, "overview": [], "statistics": {"buses": {}}})] {
            let html = body(&document);
            assert!(html.contains("No cause of trouble was found."));
            assert!(html.contains("Nothing odd was found."));
        }
    }

    #[test]
    fn sections_have_what_they_are_drawn_by() {
        for section in sections() {
            for key in ["id", "title", "rows", "empty"] {
                assert!(section[key].is_string(), "{key} of {section}");
            }
            assert!(list(&section["plots"]).iter().all(|plot| plot["title"].is_string()));
        }
    }
}
