"""Recordings and transitions: read, checked, normalised and kept on disk.

``recording``    one Parquet file each, checked against an MJCF
``labels``       of which machine a recording is, of which day, with which load
``importers``    foreign formats, one file each
``guess``        a map of a source that nobody has described
``transitions``  collections in shards, reused and resumed
``stored``       those that stay on disk, read a row group at a time
``history``      the steps before a transition, by index
``normalize``    normalisation that lives inside a model
"""
