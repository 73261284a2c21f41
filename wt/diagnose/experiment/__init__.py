"""The experiment to record next.

Map: ``excite`` designs commands, of ``motions`` of one joint each, which are made of ``signals``;
``reach`` says where joints may go, and ``trial`` simulates what commands do; ``release`` is the
experiment of a machine without drives.
"""

SOURCE = "wt diagnose --suggest-experiment"
"""What the metadata of a suggested recording name as its source."""
