"""The registered models of a store: the only module that uses MLflow's registry API.

A registered version is a model of MLflow's (``registry.mlmodel``), logged by the run that made it,
with the hashes of its graph and card in the tags. We read those two files alone, and verify them.
"""

from __future__ import annotations

import json
import re
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from registry.backend import (
    KEPT,
    NOTE,
    answering,
    chosen,
    connect,
    quiet,
    resolve_uri,
)
from registry.card import HeldOut
from registry.reference import REFERENCE
from wt.errors import RegistryError, one_line, suggest

if TYPE_CHECKING:
    from mlflow.entities import LoggedModel
    from mlflow.entities.model_registry import ModelVersion, RegisteredModel

TRACKING_ERROR = "tracking_error"
"""The metric by which walking policies are compared, and no model of ``wt fit``."""

_SETTLED = "settled"
_NAME = re.compile(r"[\w.-]+")


@dataclass(frozen=True)
class Version:
    """One registered version of a model.

    Attributes:
        name: registered name, e.g. ``"wt-r5"``.
        version: 1, 2, …
        aliases: e.g. ``("champion",)``.
        run_id: run that made it.
        created: UTC, ISO 8601.
        sha256: of ``model.onnx``.
        card_sha256: of ``card.json``.
        heldout: the metric that versions are compared by.
        decision: why it became champion, or why not, when it was pushed.
        settled: whether its push came to the end, aliases included.
    """

    name: str
    version: int
    aliases: tuple[str, ...]
    run_id: str
    created: str
    sha256: str
    card_sha256: str
    heldout: HeldOut
    decision: str
    settled: bool

    def __str__(self) -> str:
        """The reference by which it is pulled, e.g. ``wt-r5/3``."""
        return f"{self.name}/{self.version}"


@dataclass(frozen=True)
class About:
    """What a person reads of a model in MLflow.

    Attributes:
        model: on the page of the registered model.
        version: on the page of one version.
    """

    model: str
    version: str


class Store:
    """Registered models of one MLflow store.

    Attributes:
        uri: the store.
    """

    def __init__(self, uri: str | None = None, *, create: bool = False) -> None:
        """Connect; see :func:`resolve_uri` and :func:`connect`."""
        self.uri = resolve_uri(uri)
        self._client = connect(self.uri, create=create)

    def models(self) -> dict[str, dict[str, int]]:
        """Every registered name with its aliases and the versions they stand for."""
        with answering(self.uri):
            models: list[RegisteredModel] = []
            token: str | None = ""
            while token is not None:
                page = self._client.search_registered_models(page_token=token or None)
                models += page
                token = page.token or None
        return {
            m.name: {alias: int(version) for alias, version in m.aliases.items()} for m in models
        }

    def versions(self, name: str) -> list[Version]:
        """Versions of a model that were pushed from here, oldest first; none for no model."""
        aliases = self.models().get(name, {})
        with answering(self.uri):
            registered = self._client.search_model_versions(f"name='{name}'")
        ours = [v for v in registered if "card_sha256" in v.tags]
        return sorted((_version(v, aliases) for v in ours), key=lambda v: v.version)

    def resolve(self, reference: str) -> Version:
        """The version that ``name@alias`` or ``name/version`` stands for.

        Raises:
            RegistryError: the reference is malformed, or nothing has that name.
        """
        match = REFERENCE.fullmatch(reference)
        if match is None:
            raise RegistryError(
                f"{reference!r} names no model version; write NAME@ALIAS or NAME/VERSION, "
                "e.g. wt-r5@champion or wt-r5/3"
            )
        name, alias = match["name"], match["alias"]
        models = self.models()
        if name not in models:
            hint = suggest(name, models) if models else "the registry is empty, run 'wt fit' first"
            raise RegistryError(f"no model {name!r} in {self.uri}; {hint}")
        if alias is not None and alias not in models[name]:
            hint = suggest(alias, models[name]) if models[name] else "it has no alias"
            raise RegistryError(
                f"model {name!r} has no alias {alias!r}; {hint} (or name a version, {name}/1)"
            )
        number = models[name][alias] if alias is not None else int(match["version"])
        versions = {v.version: v for v in self.versions(name)}
        if number not in versions:
            known = ", ".join(str(v) for v in versions) or "none"
            raise RegistryError(f"model {name!r} has no version {number}; registered: {known}")
        return versions[number]

    def add(
        self,
        name: str,
        run_id: str,
        write: Callable[[Path, str], None],
        heldout: HeldOut,
        tags: Mapping[str, str],
        about: About,
    ) -> int:
        """Log a model's folder in a run and register it as the next version of ``name``.

        Args:
            name: as :func:`check_name` allows.
            run_id: the run that made the model.
            write: fills the folder, given it and the id of MLflow's logged model.
            heldout: the metric that versions are compared by.
            tags: ``sha256``, ``card_sha256`` and ``decision``, as in :class:`Version`, and others.
            about: what a person reads.

        Returns:
            The new version's number.

        Raises:
            RegistryError: the name cannot be used.
        """
        check_name(name)
        compared = {f"heldout.{key}": str(value) for key, value in vars(heldout).items()}
        with answering(self.uri), quiet():
            logged = self._log(name, run_id, write, {**tags, NOTE: about.version})
            self._measured(logged, run_id, heldout)
            if name not in self.models():
                self._client.create_registered_model(name, description=about.model)
            with chosen(self.uri):  # where a sqlite store looks for the logged model
                made = self._client.create_model_version(
                    name,
                    f"models:/{logged.model_id}",  # of files alone a version's page names no model
                    run_id,
                    tags={**tags, **compared},
                    description=about.version,
                    model_id=logged.model_id,
                )
            # a server does so itself: else the model's page says that it is not registered
            link = json.dumps([{"name": name, "version": int(made.version)}])
            self._client.set_logged_model_tags(logged.model_id, {"mlflow.modelVersions": link})
        return int(made.version)

    def _log(
        self, name: str, run_id: str, write: Callable[[Path, str], None], tags: Mapping[str, str]
    ) -> LoggedModel:
        """A model of a run, not registered yet, with that run's parameters and origin."""
        from mlflow.entities import LoggedModelOutput

        run = self._client.get_run(run_id)
        logged = self._client.create_logged_model(
            run.info.experiment_id,
            name,
            run_id,
            tags={**{k: v for k, v in run.data.tags.items() if k in KEPT}, **tags},
            params=run.data.params,
            model_type="onnx",
        )
        with tempfile.TemporaryDirectory(prefix="wt-push-") as folder:
            write(Path(folder), logged.model_id)
            self._client.log_model_artifacts(logged.model_id, folder)
        self._client.finalize_logged_model(logged.model_id, "READY")
        self._client.log_outputs(run_id, [LoggedModelOutput(logged.model_id, 0)])
        return logged

    def _measured(self, logged: LoggedModel, run_id: str, heldout: HeldOut) -> None:
        """Log what a model is compared by as a metric of it and of its run, with the data."""
        from mlflow.entities import Metric

        metric = Metric(
            f"heldout/{heldout.metric}",
            heldout.value,
            int(time.time() * 1000),
            0,
            model_id=logged.model_id,
            dataset_name=heldout.set,
            dataset_digest=heldout.data_hash,
            run_id=run_id,
        )
        self._client.log_batch(run_id, metrics=[metric])

    def set_alias(self, version: Version, alias: str) -> None:
        """Let ``alias`` stand for ``version`` from now on.

        Raises:
            RegistryError: MLflow does not take that alias.
        """
        if not re.fullmatch(r"[A-Za-z][\w-]*", alias) or re.fullmatch(r"latest|v\d+", alias):
            raise RegistryError(
                f"{alias!r} is no alias; start with a letter, then letters, digits, '_' and '-', "
                "but neither 'latest' nor like 'v3'"
            )
        with answering(self.uri):
            self._client.set_registered_model_alias(version.name, alias, str(version.version))

    def settle(self, version: Version) -> None:
        """Note that nothing is left to do for ``version``."""
        with answering(self.uri):
            self._client.set_model_version_tag(version.name, str(version.version), _SETTLED, "yes")

    def fetch(self, version: Version, file: str, folder: Path) -> Path:
        """Download one file of a version into ``folder``, unverified.

        Raises:
            RegistryError: the file is no longer there.
        """
        from mlflow.artifacts import download_artifacts
        from mlflow.exceptions import MlflowException

        with answering(self.uri):
            source = self._client.get_model_version_download_uri(version.name, str(version.version))
        try:
            with quiet():
                path = download_artifacts(
                    f"{source}/{file}", dst_path=str(folder), tracking_uri=self.uri
                )
            return Path(path)
        except (MlflowException, OSError) as error:
            raise RegistryError(
                f"{version} cannot give its {file} ({one_line(error)}); "
                f"restore it in {source}, or register the model again"
            ) from error


def check_name(name: str) -> None:
    """Refuse a name that no model can be registered and found again under.

    Raises:
        RegistryError: it holds more than letters, digits, ``_``, ``.`` and ``-``, or is a folder's.
    """
    # MLflow itself takes neither '/' nor ':', nor what a path would read as a folder
    if not _NAME.fullmatch(name) or name in (".", ".."):
        raise RegistryError(
            f"{name!r} is no model name; use letters, digits, '_', '.' and '-', e.g. wt-r5"
        )


def _version(registered: ModelVersion, aliases: Mapping[str, int]) -> Version:
    tags, number = registered.tags, int(registered.version)
    return Version(
        name=registered.name,
        version=number,
        aliases=tuple(sorted(a for a, v in aliases.items() if v == number)),
        run_id=registered.run_id or "",
        created=datetime.fromtimestamp(registered.creation_timestamp / 1e3, UTC).isoformat(
            timespec="seconds"
        ),
        sha256=tags["sha256"],
        card_sha256=tags["card_sha256"],
        heldout=HeldOut(
            set=tags["heldout.set"],
            data_hash=tags["heldout.data_hash"],
            metric=tags["heldout.metric"],
            value=float(tags["heldout.value"]),
        ),
        decision=tags["decision"],
        settled=_SETTLED in tags,
    )
