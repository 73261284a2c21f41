"""Fine-tuning of a walking policy on translated dynamics and by rival ways, evaluated in R.

``config`` says what ``conf/finetune_*.yaml`` may hold, ``setting`` which robots, models and policy
that means, ``start`` takes the base policy's weights over, ``translated`` and ``randomized`` are
environments of ``wt.locomotion`` with other dynamics, ``evaluate`` the paper's three figures on one
sequence of commands in R, ``results`` their table, ``training`` one training, ``trainings`` all of
them side by side, ``job`` the whole. PPO, checkpoints and export are those of ``wt.locomotion``.
"""
