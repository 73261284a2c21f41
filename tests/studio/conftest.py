"""A studio without a network around it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from wt.studio.app import make
from wt.studio.guard import Guard
from wt.studio.jobs import Job, Jobs
from wt.studio.session import Session
from wt.studio.uploads import MB

TOKEN, PORT = "secret", 8745
OWN = f"http://127.0.0.1:{PORT}"


@dataclass
class Studio:
    """A session with its jobs, and a browser's requests to it."""

    session: Session
    jobs: Jobs
    browser: TestClient

    def drop(self, path: Path, name: str | None = None) -> str:
        """Drop a file; what the server says."""
        answer = self.browser.put(f"/{TOKEN}/files/{name or path.name}", content=path.read_bytes())
        return f"{answer.status_code} {answer.text}"

    def post(self, path: str, **fields: str | list[str]) -> str:
        """Submit a form; the part of the page that comes back."""
        answer = self.browser.post(f"/{TOKEN}/{path}", data=fields)
        assert answer.status_code == 200, answer.text
        return answer.text

    def get(self, path: str) -> str:
        """Load something."""
        answer = self.browser.get(f"/{TOKEN}/{path}")
        assert answer.status_code == 200, answer.text
        return answer.text

    def ended(self, work: str) -> Job:
        """A job when it is over."""
        job = self.jobs.latest(work)
        assert job is not None
        job.wait(60.0)
        assert not job.running
        return job


@pytest.fixture
def jobs(tmp_path: Path) -> Iterator[Jobs]:
    all_of_them = Jobs(tmp_path / "session")
    yield all_of_them
    all_of_them.stop()


@pytest.fixture
def studio(tmp_path: Path, jobs: Jobs) -> Studio:
    session = Session(tmp_path / "session")
    guard = Guard(make(session, jobs, 2 * MB), TOKEN, PORT)
    browser = TestClient(guard, base_url=OWN, headers={"origin": OWN})  # type: ignore[arg-type]
    return Studio(session, jobs, browser)


@pytest.fixture(scope="session")
def cart(root: Path) -> Path:
    """The example with a cart: model.xml, 1.parquet, 2.parquet."""
    return root / "examples" / "cart"
