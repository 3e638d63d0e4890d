"""Where a live tap sends what it decides: brokers and scrapers, not files.

Each is a sink and needs an extra package, which is imported when it is asked for.
"""
