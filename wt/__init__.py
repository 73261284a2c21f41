"""World Translation: when a simulator and a robot disagree, translate between them.

Map of the package (each concept has one home):

=====================  =====================================================================
``wt.types``           the frozen nouns that travel between stages: Recording, Transitions, Pairs
``wt.errors``          one class per mistake a user can make; each says what to do next
``wt.cluster``         a Ray cluster, for replays and for collection
``wt.config``          what ``conf/*.yaml`` may say; ``wt.schema`` reads and checks it
``wt.worlds``          one file a task: robot model, two domains, hidden variable, policy
``wt.locomotion``      training of the policies that legged robots walk with
``wt.data``            recordings, importers, collections on disk, normalisation, history
``wt.nets``            encoder, FiLM decoder, blind decoder, classifier, translator; their frame
``wt.losses``          the paper's objectives as pure functions, and our robust one
``wt.train``           mean field, then Algorithm 1 as a LightningModule with its phases
``wt.translate``       simulation → reality on tensors: shared by evaluation, export, deploy
``wt.baselines``       what translation is compared with, one file each, one interface
``wt.check``           whether a model and a recording say what they claim, one file an audit
``wt.diagnose``        from recordings to the physics that a model leaves out; can be called
``wt.show``            what reports share: colours, charts as SVG, robots in Rerun, whole files
``wt.evaluate``        single-step errors, rollouts, probes, result tables, figures, recordings
``wt.export``          the ONNX graph with its normaliser inside
``wt.run.track``           a run in MLflow
``wt.fit``             the main job; ``study`` is what its steps share, ``jobs`` trains side by
                       side, ``publish`` writes, exports and registers what came out
``wt.joined``          translation, diagnosis, and translation on the patched simulator
``wt.registered``      a registered model on its task, and as evidence for a diagnosis
``wt.ask``             the next experiment, designed and run in a closed loop
``wt.passport``        one robot over units, sessions and loads: whose a mismatch is, what changed
``wt.studio``          check, mapping, diagnosis and report on one local page
``wt.reproduce``       the paper's tables and figures, one file each, in one report
``wt.finetune``        walking policies adapted to translated dynamics, beside their rivals
``wt.cli``             one module a command
=====================  =====================================================================

The model registry is its own package, ``registry``; of this one it needs types and errors only.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from wt.version import __version__ as __version__

if TYPE_CHECKING:
    from wt.diagnose import diagnose as diagnose
    from wt.mjcf.simulator import Simulator as Simulator


def __getattr__(name: str) -> object:
    """``wt.diagnose`` and ``wt.Simulator``, loaded when they are first used (PEP 562)."""
    if name == "diagnose":
        return importlib.import_module("wt.diagnose")
    if name == "Simulator":
        return importlib.import_module("wt.mjcf.simulator").Simulator
    raise AttributeError(f"module 'wt' has no attribute {name!r}")
