"""Model files: found, checked against their sha256, opened with onnxruntime, and asked what contract they keep.

A file says what it is in its metadata key ``galoc.contract``: ``columns/1`` (boundary angles per column, see
:mod:`galoc.detect.onnx`) or ``graph/1`` (junctions and edges, see :mod:`galoc.detect.graph`).
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc import assets
from galoc.errors import GalocError

CONTRACT_KEY = "galoc.contract"
"""Metadata key of an ONNX file that names the contract it keeps."""
COLUMNS, GRAPH = "columns/1", "graph/1"
"""The contracts that this version of galoc knows."""
SHIPPED = "models/layout.onnx"
"""Asset name of the model that ships with galoc; its facts, with the sha256, lie beside it as .json."""

_LEFT_BEHIND: list[Any] = []
"""Sessions of a parent process: to free one in a forked child would wait for threads that are not there."""


def shipped_model() -> tuple[Path, str]:
    """Path of the model that ships with galoc, and the sha256 that it has to have.

    Raises:
        GalocError: this galoc ships none, or its facts are missing or damaged.
    """
    path = assets.root() / SHIPPED
    if not path.is_file():
        raise GalocError(
            "no model, and none ships with this galoc", "an ONNX file that keeps a galoc contract", "Pass model=PATH."
        )
    return path, str(model_facts(path)["sha256"])


def model_facts(path: Path) -> dict[str, Any]:
    """What is written beside a model: its sha256 and how it was trained.

    Raises:
        GalocError: no such file, or no JSON object with a sha256.
    """
    beside = path.with_suffix(".json")
    try:
        facts = json.loads(beside.read_text(encoding="utf-8"))
        sound = isinstance(facts, dict) and _is_sha256(facts.get("sha256"))
    except (OSError, ValueError):
        facts, sound = {}, False
    if not sound:
        raise GalocError(
            f"no sha256 in {beside.name!r} beside the model",
            "a JSON object with the model's sha256",
            "Reinstall galoc.",
        )
    return dict(facts)


class Model:
    """An ONNX file, open: a session that can be copied, pickled and used after a fork, where it opens the file anew.

    Args:
        path: the file.
        providers: of onnxruntime, best first.
        threads: that one inference uses.
        sha256: that the file has to have; None: any.

    Raises:
        GalocError: no such file, another sha256, no ONNX, an unknown contract, providers or threads that are not there.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        providers: Sequence[str] = ("CPUExecutionProvider",),
        threads: int = 1,
        sha256: str | None = None,
    ) -> None:
        if not isinstance(path, str | os.PathLike):
            raise GalocError(f"model = {path!r}", "the path of an ONNX file", "Pass a string or a Path.")
        self.path = Path(path)
        self._providers, self._threads = _checked_providers(providers), _checked_threads(threads)
        if sha256 is not None and not _is_sha256(sha256):
            raise GalocError(
                f"sha256 = {sha256!r}", "64 hexadecimal digits", "Copy what sha256sum prints for the file."
            )
        self.sha256: str = sha256.lower() if sha256 else ""
        """Of the file, 64 hexadecimal digits."""
        self._session: Any = None
        self._process = 0
        session = self.session
        self.metadata: dict[str, str] = dict(session.get_modelmeta().custom_metadata_map)
        """All metadata of the file."""
        self.contract = _checked_contract(self.name, self.metadata)
        """The contract that the file keeps."""

    @property
    def name(self) -> str:
        """How messages call it."""
        return f"model {self.path.name or str(self.path)!r}"

    @property
    def session(self) -> Any:
        """The ``onnxruntime.InferenceSession`` of this process."""
        if self._session is None or self._process != os.getpid():
            if self._session is not None:
                _LEFT_BEHIND.append(self._session)
            data = _read(self.path, self.name)
            found = hashlib.sha256(data).hexdigest()
            if self.sha256 and found != self.sha256:
                raise GalocError(
                    f"{self.name} with sha256 {found}",
                    f"sha256 {self.sha256}",
                    "The file was changed, cut short or mixed up: fetch it again.",
                )
            self.sha256 = found
            self._session, self._process = self._opened(data), os.getpid()
        return self._session

    def get_inputs(self) -> list[Any]:
        """Declared inputs, as a session has them: ``name``, ``shape``, ``type``."""
        return list(self.session.get_inputs())

    def get_outputs(self) -> list[Any]:
        """Declared outputs."""
        return list(self.session.get_outputs())

    def run(self, wanted: Sequence[str], feeds: dict[str, NDArray]) -> list[NDArray]:
        """Outputs of one inference, in the order asked for.

        Raises:
            GalocError: the model broke on this input.
        """
        session = self.session
        try:
            return [np.asarray(part) for part in session.run(list(wanted), feeds)]
        except Exception as error:  # onnxruntime's errors share no base class but this
            shapes = ", ".join(f"{name} {value.shape}" for name, value in feeds.items())
            raise GalocError(
                f"{self.name} that fails on {shapes} ({reason(error)})",
                f"a model that keeps the contract {self.contract}",
                "Export it with a free axis where the contract has one.",
            ) from error

    def __getstate__(self) -> dict[str, Any]:
        """All but the session: its threads and memory belong to this process."""
        return {**self.__dict__, "_session": None}

    def _opened(self, data: bytes) -> Any:
        onnxruntime = _onnxruntime()
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads, options.inter_op_num_threads = self._threads, 1
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # idle threads leave the cores alone
        options.use_deterministic_compute = True
        options.log_severity_level = 4  # what goes wrong is raised, not also printed
        try:
            session = onnxruntime.InferenceSession(data, options, providers=self._providers)
        except Exception as error:  # as above
            raise GalocError(
                f"{self.name} that onnxruntime cannot open ({reason(error)})",
                "one whole ONNX file, weights inside",
                "Fetch or export it again.",
            ) from error
        missing = [name for name in self._providers if name not in session.get_providers()]
        if missing:  # onnxruntime goes on with what is left
            raise GalocError(
                f"providers {missing} that do not start on this machine",
                f"some of {session.get_providers()}",
                "Check the driver, or leave providers out.",
            )
        return session


def _onnxruntime() -> Any:
    """The library, which takes a while to import."""
    import onnxruntime

    return onnxruntime


def reason(error: Exception) -> str:
    """The first line of an error of onnxruntime, without its codes, cut to a readable length."""
    text = str(error).strip().splitlines()
    line = (text[0] if text else type(error).__name__).rsplit("[ONNXRuntimeError] : ", 1)[-1]
    line = line.split(" : ", 2)[-1].rstrip(".")
    return line if len(line) <= 140 else line[:137] + "..."


def _read(path: Path, name: str) -> bytes:
    if not path.is_file():
        what = "is a folder" if path.is_dir() else "does not exist"
        raise GalocError(f"{name} which {what} ({str(path)!r})", "an ONNX file", "Fix the path.")
    try:
        return path.read_bytes()
    except OSError as error:
        got = f"{name} which cannot be read ({error.strerror})"
        raise GalocError(got, "a readable ONNX file", "Fix its permissions.") from error


def _checked_contract(name: str, metadata: dict[str, str]) -> str:
    contract = metadata.get(CONTRACT_KEY)
    expected = f"{CONTRACT_KEY} = {COLUMNS!r} or {GRAPH!r}"
    if contract is None:
        cure = "It is a network of another kind. Write the key when you export a network that keeps a contract."
        raise GalocError(f"{name} without {CONTRACT_KEY} in its metadata", expected, cure)
    if contract not in (COLUMNS, GRAPH):
        raise GalocError(f"{name} with contract {contract!r}", expected, "Update galoc, or take an older model.")
    return contract


def _checked_providers(providers: Sequence[str]) -> list[str]:
    onnxruntime = _onnxruntime()
    there = onnxruntime.get_available_providers()
    wanted = [] if isinstance(providers, str) else list(providers)
    if not wanted or any(name not in there for name in wanted):
        cure = "Leave providers out, or install the onnxruntime build that has them."
        raise GalocError(f"providers = {providers!r}", f"a sequence of some of {there}", cure)
    return wanted


def _checked_threads(threads: int) -> int:
    if isinstance(threads, bool) or not isinstance(threads, int | np.integer) or not 1 <= threads <= 1024:
        raise GalocError(f"threads = {threads!r}", "a whole number from 1 to 1024", "Pass threads=1, say.")
    return int(threads)


def _is_sha256(text: object) -> bool:
    return isinstance(text, str) and len(text) == 64 and not set(text.lower()) - set("0123456789abcdef")
