"""What a person sees of a result: numbers, figures and recordings.

``single_step``   teacher-forced errors of every method on paired transitions
``results``       the numbers as ``results.json``, ``results.md`` and a table in the terminal
``paper``         the paper's numbers
``figures``       the numbers as matplotlib figures
``rollout_view``  the arms moving side by side, as a Rerun recording (``robot_view``: one arm)
``colors``        one colour a method, everywhere
``files``         write a file whole or not at all
"""
