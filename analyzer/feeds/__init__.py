"""Feeds of a live tap to other programs: an MQTT broker, Prometheus.

Each feed is a sink, and needs an extra package that is imported only when it is used.
"""
