"""What people look at: tables, statistics, frames, live screens.

Views draw rows, statistics and blocks of frames; they make no decisions about bytes.
"""
