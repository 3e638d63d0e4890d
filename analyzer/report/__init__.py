"""The report: one page in a file of its own, and the document that it shows.

`document` gathers what is known of a recording in one JSON object (docs/stats.schema.json describes
it), `model` turns it into headings, texts and cells by the table `layout.toml`, and `page` writes
them as HTML. The scripts in `assets/` do the same in a browser for a document that is dropped on
the page, and draw the plots.
"""
