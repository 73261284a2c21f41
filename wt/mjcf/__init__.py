"""MJCF as text that keeps what the user wrote: layout, comments, names and options.

Map: ``text`` edits XML in place; ``standalone`` makes a text that loads from any folder;
``compare`` tells what an edit of an MjSpec changed; ``edit`` writes effects into the file.
"""
