"""The report: one page in a file of its own, and the document that it shows.

The core (crates/modlens-report) gathers what is known of a recording in one JSON object, the
document (docs/stats.schema.json describes it), and writes it as HTML, by the table `layout.toml`.
`document` asks it for the former; `page` makes a file of the latter, with the scripts in `assets/`,
which draw the plots.
"""
