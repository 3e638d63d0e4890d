"""The report: one page in a file of its own, and the document that it shows.

`document` gathers what is known of a recording in one JSON object (docs/stats.schema.json describes
it). The core (crates/modlens-report) writes it as HTML, by the table `layout.toml`; `page` makes a
file of that, with the scripts in `assets/`, which draw the plots.
"""
