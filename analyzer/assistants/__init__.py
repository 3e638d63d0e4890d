"""What assistants (language models with tools) use: a server of read-only tools, and a skill.

`protocol` speaks the Model Context Protocol over two streams, `tools` has the six tools, `fence`
says which files they may read, `answers` bounds what they return. Nothing here writes a file or
opens a port.
"""
