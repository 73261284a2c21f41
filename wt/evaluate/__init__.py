"""What a person sees of a result: numbers, figures and recordings.

``single_step``     teacher-forced errors of every method on paired transitions
``multi_step``      rollouts on a method's own predictions (``correction``: of actions, not states)
``representation``  what a model makes of transitions: features before and after translation
``probes``          what can be read off them: the hidden variable, the domain
``embedding``       them in the plane, for the eye
``results``         the numbers as ``results.json``, ``results.md`` and a table in the terminal
``paper``           the paper's numbers
``figures``         the numbers as matplotlib figures
``rollout_view``    the arms moving side by side, as a Rerun recording
"""
