"""The paper's evaluation again: every task, by the same code as ``wt fit``, and one report.

=============  ==================================================================================
``tasks``      the paper's six tasks, each a configuration in ``conf/`` and a run in a folder
``table``      single-step errors of all of them, ours beside the paper's: text and figure
``report``     what is written: ``report.md`` and the figure beside it
=============  ==================================================================================
"""
