"""The paper's evaluation again, and what goes beyond it, in one report.

=============  ==================================================================================
``tasks``      the paper's six tasks, each a configuration in ``conf/``
``exhibit``    the contract of a table or figure, and how to add one
``exhibits``   one file a table or figure
``bench``      runs and trained models that exhibits share; each is trained once
``numbers``    what was measured, kept and found again
``report``     what is written: ``report.md``, ``report.html`` and the figures
``words``      cells and sentences that exhibits share
=============  ==================================================================================
"""
