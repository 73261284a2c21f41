"""The routes of the page: each reads a form, starts a job or shows one, and answers with a part."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from urllib.parse import parse_qsl

from fastapi import FastAPI, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse, HTMLResponse, PlainTextResponse, Response
from fastapi.staticfiles import StaticFiles
from jinja2 import Environment, PackageLoader, StrictUndefined
from starlette.background import BackgroundTask

from wt.errors import UserError, WTError
from wt.show.page import style
from wt.studio import uploads
from wt.studio.guard import REPORT
from wt.studio.jobs import Job, Jobs
from wt.studio.session import MODEL, Session
from wt.studio.view import View

_FORM = 2**20  # bytes of a form
_CURVES_S = 60.0
_LIVE = {"check": "check", "diagnosis": "diagnose"}
"""Parts of the page, and their works."""


def make(session: Session, jobs: Jobs, limit: int) -> FastAPI:
    """The application, to be put behind a :class:`~wt.studio.guard.Guard`.

    Args:
        session: its folder.
        jobs: that work in this folder.
        limit: size of an upload [bytes].
    """
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    studio = _Studio(session, jobs, limit)
    app.add_exception_handler(WTError, _one_line)
    app.add_exception_handler(Exception, _unexpected)
    here = Path(__file__).parent
    app.mount("/static", StaticFiles(directory=here / "static"))
    if session.models() or session.logs():  # of an earlier time
        studio.begin()
    for path, method, route in studio.routes():
        app.add_api_route(path, route, methods=[method], response_class=HTMLResponse)
    return app


async def _one_line(request: Request, error: Exception) -> Response:
    return PlainTextResponse(str(error), status_code=400)


async def _unexpected(request: Request, error: Exception) -> Response:
    line = f"unexpected {type(error).__name__}: {' '.join(str(error).split())}"
    return PlainTextResponse(line, status_code=500)


async def _fields(request: Request) -> dict[str, list[str]]:
    """The fields of a form, which browsers send as one long query."""
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > _FORM:
            raise UserError("the form is too large")
    fields: dict[str, list[str]] = {}
    for name, value in parse_qsl(body.decode("utf-8", "replace"), keep_blank_values=True):
        fields.setdefault(name, []).append(value)
    return fields


class _Studio:
    """What the routes share."""

    def __init__(self, session: Session, jobs: Jobs, limit: int) -> None:
        self.session, self.jobs, self.limit = session, jobs, limit
        self.view = View(session, jobs, limit)
        self._templates = Environment(
            loader=PackageLoader("wt.studio"),
            undefined=StrictUndefined,
            autoescape=True,
            trim_blocks=True,
            lstrip_blocks=True,
        )

    def routes(self) -> list[tuple[str, str, Callable[..., Awaitable[Response]]]]:
        """Path, method and function of each."""
        return [
            ("/", "GET", self.page),
            ("/page.css", "GET", self.style),
            ("/live/{name}", "GET", self.live),
            ("/files/{name:path}", "PUT", self.upload),
            ("/remove", "POST", self.remove),
            ("/model", "POST", self.choose),
            ("/check", "POST", self.check),
            ("/mapping", "GET", self.mapping),
            ("/mapping", "POST", self.keep_map),
            ("/curves", "POST", self.curves),
            ("/diagnosis", "POST", self.diagnose),
            ("/stop", "POST", self.stop),
            ("/out/{name:path}", "GET", self.output),
            ("/download", "GET", self.download),
        ]

    def html(
        self,
        template: str,
        log: str = "",
        fixes: bool = False,
        line: str = "",
        alone: bool = False,
        job: Job | None = None,
        part: str = "",
    ) -> HTMLResponse:
        """A template, filled with how everything stands.

        Args:
            template: its name.
            log: whose columns are mapped.
            fixes: whether as the check proposes.
            line: what went wrong.
            alone: whether it replaces a part of the page.
            job: whose result is shown.
            part: of which it is the job.
        """
        given = {"log": log, "fixes": fixes, "line": line, "job": job, "part": part}
        given |= {"alone": alone, "oob": False}
        source = self._templates.get_template(f"{template}.html")
        return HTMLResponse(source.render(v=self.view, **given))

    async def page(self) -> Response:
        """All of it."""
        return self.html("page")

    async def style(self) -> Response:
        """What reports look like."""
        return Response(style().replace("$shades", ""), media_type="text/css")

    async def live(self, name: str) -> Response:
        """How far a part is: what changes of it while its job runs, else all of it."""
        if name not in _LIVE:
            raise UserError(f"the page has no part {name!r} that works")
        job = self.jobs.latest(_LIVE[name])
        if job is not None and job.running:
            return self.html("live", job=job, part=name)
        if name == "diagnosis" and (check := self.jobs.latest("check")) and check.running:
            return Response(status_code=204)  # which leaves the page as it is
        answer = self.html(name, alone=True)
        answer.headers.update({"HX-Retarget": f"#{name}", "HX-Reswap": "outerHTML"})
        return answer

    async def upload(self, name: str, request: Request) -> Response:
        """A dropped file, as the body of the request; an archive is unpacked."""
        size = request.headers.get("content-length", "0")
        if not size.isdecimal() or int(size) > self.limit:
            raise UserError(uploads.too_large(name, self.limit))
        target = self.session.folder / uploads.place(name)
        await uploads.receive(request.stream(), target, self.limit)
        if target.suffix.lower() == ".zip":
            archive = target.relative_to(self.session.folder).as_posix()
            job = self.jobs.start("unpack", archive=archive, limit=self.limit)
            await run_in_threadpool(job.wait)
            if job.state != "done":
                target.unlink(missing_ok=True)
                raise UserError(job.line)
        return PlainTextResponse(f"{name} is there")

    async def remove(self, request: Request) -> Response:
        """Take a dropped file away again; it is a copy."""
        name = _one(await _fields(request), "name")
        if self._needed(name):
            raise UserError(f"{name!r} is being diagnosed; stop the diagnosis first, or let it end")
        self.session.remove(name)
        return self._checked()

    def _needed(self, name: str) -> bool:
        """Tell whether a diagnosis that runs needs a dropped file: of a model's, every one."""
        job = self.jobs.latest("diagnose")
        if job is None or not job.running:
            return False
        made = self.session.recording_of(name) if name in self.session.logs() else name
        return name.startswith(f"{MODEL}/") or not {name, made}.isdisjoint(job.reads)

    async def choose(self, request: Request) -> Response:
        """Take another of the dropped files for the model."""
        self.session.choose(_one(await _fields(request), "model"))
        return self._checked()

    async def check(self) -> Response:
        """Check all that is there."""
        return self._checked()

    def _checked(self) -> Response:
        self.begin()
        return self.html("check", alone=True)

    def begin(self) -> None:
        """Check what is there."""
        session = self.session
        logs = [
            {"log": log, "map": session.map_of(log), "recording": session.recording_of(log)}
            for log in session.logs()
        ]
        self.jobs.start("check", model=session.model(), logs=logs)

    async def mapping(self, log: str = "", fixes: bool = False) -> Response:
        """The form of another log, or with what the check proposes."""
        return self.html("mapping", log=log, fixes=fixes)

    async def curves(self, request: Request) -> Response:
        """The channels as they would be with the form as it is now."""
        fields = await _fields(request)
        log = self._log(fields)
        job = self.jobs.start("curves", model=self.session.model(), log=log, fields=_first(fields))
        await run_in_threadpool(job.wait, _CURVES_S)
        return self.html("curves", job=job)

    async def keep_map(self, request: Request) -> Response:
        """Write the map, and check anew."""
        fields = await _fields(request)
        others = {log: self.session.map_of(log) for log in self.session.logs()}
        job = self.jobs.start(
            "keep_map", log=self._log(fields), fields=_first(fields), others=others
        )
        await run_in_threadpool(job.wait)
        if job.state != "done":
            return self.html("check", alone=True, line=job.line)
        return self._checked()

    async def diagnose(self, request: Request) -> Response:
        """Start a diagnosis, if none runs: of another tab's, hours may be lost."""
        before = self.jobs.latest("diagnose")
        if before is not None and before.running:
            line = "a diagnosis runs already; stop it first, or let it end"
            return self.html("diagnosis", alone=True, line=line)
        held = (await _fields(request)).get("holdout", [])
        there, model = self.view.recordings, self.session.model()
        fitted = [r for r in there if r not in held]
        if model is None or not fitted or not set(held) <= set(there):
            line = "a diagnosis needs a model and a recording that is not held out"
            return self.html("diagnosis", alone=True, line=line)
        out = self.session.next_diagnosis()
        job = self.jobs.start("diagnose", model=model, fitted=fitted, held=held, out=out)
        job.commands = self.session.diagnosing(fitted, held, out)
        job.reads = (model, *fitted, *held)
        return self.html("diagnosis", alone=True)

    async def stop(self) -> Response:
        """End the diagnosis."""
        if job := self.jobs.latest("diagnose"):
            await run_in_threadpool(job.stop)
        return self.html("diagnosis", alone=True)

    async def output(self, name: str) -> Response:
        """A page that a command wrote, which may load nothing and ask nobody."""
        path = self.session.output(name)
        return FileResponse(
            path, media_type="text/html", headers={"content-security-policy": REPORT}
        )

    async def download(self) -> Response:
        """The whole folder as a .zip."""
        path = await run_in_threadpool(self.session.packed)
        gone = BackgroundTask(path.unlink, missing_ok=True)
        name = f"{self.session.folder.name}.zip"
        return FileResponse(path, media_type="application/zip", filename=name, background=gone)

    def _log(self, fields: Mapping[str, list[str]]) -> str:
        log = _one(fields, "log")
        if log not in self.session.logs():
            raise UserError(f"{log!r} is none of the logs that were dropped")
        return log


def _one(fields: Mapping[str, list[str]], name: str) -> str:
    return fields.get(name, [""])[0]


def _first(fields: Mapping[str, list[str]]) -> dict[str, str]:
    return {name: values[0] for name, values in fields.items()}
