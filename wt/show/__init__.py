"""Common parts of reports: colours, numbers as text, charts as SVG, robots in Rerun, whole files.

``files`` writes all or nothing; ``colors`` gives each thing one colour everywhere; ``text`` rounds;
``charts`` draws SVG without a plotting library; ``robot_view`` logs a moving MJCF to Rerun.
"""
