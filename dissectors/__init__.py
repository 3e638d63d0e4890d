"""The meaning of Modbus' bytes: table of functions, decoding, crafting, explaining.

Takes bytes and text; knows nothing of ports, files or screens. The knowledge is in
`functions.toml`, `vendor/*.toml` and `vocabulary.toml`, which the Rust core embeds and interprets;
the modules here read it back, give it types and put it into words.

- `table`, `vocabulary`: the rows and the names, typed
- `pdu`: the direction that a layout suggests
- `describe`: bytes beside meaning
- `explain`: a function, exception or finding in words
- `craft`: frames from keywords
- `layers`: scapy classes (the only one that imports scapy)
- `errors`: what modlens raises
"""
