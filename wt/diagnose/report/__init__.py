"""A diagnosis for people: on the terminal, as a page, and as a Rerun recording.

Map: ``text`` is its sentences, ``charts`` and ``drawing`` its pictures, ``page`` the HTML;
``traces`` are the replays to show, ``rerun`` plays them; ``write`` writes all into a folder.
"""
