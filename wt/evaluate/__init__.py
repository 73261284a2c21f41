"""From predictions to what a person sees: numbers, figures and recordings.

``single_step``     teacher-forced errors of every method on paired transitions
``multi_step``      rollouts on a method's own predictions
``alignment``       the simulator follows a translation: by state, stance or action
``representation``  features of transitions, before and after translation
``probes``          the hidden variable and the domain, read off features
``embedding``       them in the plane, for the eye
``results``         the numbers as ``results.json``, ``results.md`` and a table in the terminal
``paper``           the paper's numbers
``figures``         the numbers as matplotlib figures
``rollout_view``    the arms moving side by side, as a Rerun recording
"""
