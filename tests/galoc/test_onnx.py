"""The learned detector: models found, checked, run and refused; images refused; copies, pickles and forks."""

import copy
import hashlib
import json
import multiprocessing
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from galoc import Camera, GalocError, Wireframe, assets
from galoc.cli import main
from galoc.detect.check_frames import check, check_frames
from galoc.detect.columns import Columns
from galoc.detect.model import SHIPPED, Model, reason
from galoc.detect.onnx import OUTPUTS, OnnxDetector, network_input
from galoc.detect.pictures import checked_picture, is_blank
from galoc.detect.strip import upright_strip

onnx = pytest.importorskip("onnx")

CAMERA = Camera.from_hfov(96, 72, 80.0)
LEVEL = (0.0, 0.0)
PICTURE = np.random.default_rng(0).integers(0, 256, (72, 96, 3), np.uint8)
BIASES = {"elevation": (0.5, -0.4), "sigma": (0.05, 0.02), "sure": (0.9, 0.8), "visible": (0.7, 0.6),
          "in_frame": (0.75, 0.65), "edge": (0.3, 0.1)}  # fmt: skip


def save_model(
    path: Path,
    *,
    contract: str | None = "columns/1",
    gain: float = 1e-3,
    biases: dict[str, Any] | None = None,
    rename: dict[str, str] | None = None,
    leave_out: tuple[str, ...] = (),
    width: int | str = "W",
    channels: int = 4,
    double: bool = False,
    opset: int = 13,
) -> Path:
    """A network of one layer: each output is its bias plus ``gain`` times the mean of the strip's column."""
    from onnx import TensorProto as T
    from onnx import helper as h

    rename, kind = rename or {}, T.DOUBLE if double else T.FLOAT
    nodes = [
        h.make_node("ReduceMean", ["strip"], ["wide"], axes=[2], keepdims=0),
        h.make_node("AveragePool", ["wide"], ["narrow"], kernel_shape=[2], strides=[2]),
    ]
    weights, results = [], []
    for name, bias in {**BIASES, **(biases or {})}.items():
        if name in leave_out:
            continue
        weights.append(h.make_tensor(f"{name}.w", T.FLOAT, [len(bias), channels, 1], [gain] * (channels * len(bias))))
        weights.append(h.make_tensor(f"{name}.b", T.FLOAT, [len(bias)], bias))
        source, final = "wide" if name == "edge" else "narrow", rename.get(name, name)
        nodes.append(h.make_node("Conv", [source, f"{name}.w", f"{name}.b"], [f"{final}.float"]))
        nodes.append(h.make_node("Cast", [f"{final}.float"], [final], to=kind))
        results.append(h.make_tensor_value_info(final, kind, None))
    entry = h.make_tensor_value_info("strip", T.FLOAT, [1, channels, 128, width])
    model = h.make_model(
        h.make_graph(nodes, "tiny", [entry], results, weights), opset_imports=[h.make_opsetid("", opset)]
    )
    model.ir_version = 9
    if contract is not None:
        h.set_model_props(model, {"galoc.contract": contract, "note": "tiny"})
    path.write_bytes(model.SerializeToString())
    return path


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_model(tmp_path_factory.mktemp("models") / "tiny.onnx")


class Decoder:
    """Stands in for the decoder: remembers what it was given."""

    def __init__(self) -> None:
        self.calls: list[tuple[Columns, Any]] = []

    def decode(self, columns: Columns, camera: Camera, gravity: Any, *, log_ratio: Any = None) -> Wireframe:
        self.calls.append((columns, log_ratio))
        ends = [[10.0, 10.0], [80.0, 12.0]], [[10.0, 60.0], [80.0, 58.0]]
        return Wireframe(*ends, [True, True], [True, True], [[0, 1]])


@pytest.fixture
def decoder(monkeypatch: pytest.MonkeyPatch) -> Decoder:
    stand_in = Decoder()
    monkeypatch.setitem(sys.modules, "galoc.detect.decode", stand_in)
    return stand_in


def test_columns_are_what_the_network_says(tiny: Path) -> None:
    found = OnnxDetector(tiny).columns(PICTURE, CAMERA, (0.05, -0.1))
    strip = upright_strip(PICTURE, CAMERA, (0.05, -0.1))
    mean = network_input(strip)[0].astype(np.float64).mean(axis=1)  # (4, W)
    pairs = mean.reshape(4, -1, 2).mean(axis=2)
    for name in OUTPUTS:
        source = mean if name == "edge" else pairs
        wanted = np.array(BIASES[name])[:, None] + 1e-3 * source.sum(axis=0)
        np.testing.assert_allclose(getattr(found, name), wanted, atol=1e-6)  # float32 sums of 128 numbers up to 4
    np.testing.assert_array_equal(found.azimuths, strip.azimuths)
    assert len(found) == strip.columns // 2 and len(found.edge_azimuths) == strip.columns
    # Centres of two narrow columns each, 0.5 degrees apart.
    np.testing.assert_allclose(found.edge_azimuths.reshape(-1, 2).mean(axis=1), found.azimuths, atol=1e-12)


def test_input_is_rgb_and_mask() -> None:
    red = np.zeros((72, 96, 3), np.uint8)
    red[..., 0] = 255
    planes = network_input(upright_strip(red, CAMERA, LEVEL))
    covered = planes[0, 3] == 1.0
    assert planes.dtype == np.float32 and set(np.unique(planes)) == {0.0, 1.0} and covered.any() and not covered.all()
    np.testing.assert_array_equal(planes[0, 0], planes[0, 3])
    assert not planes[0, 1:3].any()


def test_detect_decodes_columns_and_heights(tiny: Path, decoder: Decoder) -> None:
    detector = OnnxDetector(tiny)
    assert detector.uses_heights
    assert len(detector.detect(PICTURE, CAMERA, LEVEL, log_ratio=(0.1, 0.02))) == 2
    detector.detect(PICTURE, CAMERA, LEVEL)
    assert [ratio for _, ratio in decoder.calls] == [(0.1, 0.02), None]
    assert decoder.calls[0][0].elevation.tobytes() == detector.columns(PICTURE, CAMERA, LEVEL).elevation.tobytes()


@pytest.mark.parametrize("hfov_deg", [1.0, 46.0, 80.0, 112.0, 170.0])
def test_every_field_of_view(tiny: Path, hfov_deg: float) -> None:
    camera = Camera.from_hfov(96, 72, hfov_deg)
    found = OnnxDetector(tiny).columns(PICTURE, camera, LEVEL)
    assert np.degrees(found.azimuths[-1] - found.azimuths[0]) >= min(hfov_deg, 118.0)


def test_same_bytes_again_and_with_more_threads(tiny: Path) -> None:
    first, again, wide = (OnnxDetector(tiny, threads=n).columns(PICTURE, CAMERA, LEVEL) for n in (1, 1, 2))
    for name in OUTPUTS:
        assert getattr(first, name).tobytes() == getattr(again, name).tobytes()
        np.testing.assert_allclose(getattr(wide, name), getattr(first, name), atol=1e-6)  # sums in another order


def test_copies_and_pickles_work(tiny: Path) -> None:
    detector = OnnxDetector(tiny)
    wanted = detector.columns(PICTURE, CAMERA, LEVEL).edge.tobytes()
    for other in (copy.deepcopy(detector), copy.copy(detector), pickle.loads(pickle.dumps(detector))):
        assert other.columns(PICTURE, CAMERA, LEVEL).edge.tobytes() == wanted
    assert len(pickle.dumps(detector)) < 4000  # a path and a few words, not the weights


def test_a_pickle_refuses_a_file_that_was_changed(tmp_path: Path) -> None:
    path = save_model(tmp_path / "m.onnx")
    sent = pickle.dumps(OnnxDetector(path))
    save_model(path, gain=2e-3)
    with pytest.raises(GalocError, match="sha256"):
        pickle.loads(sent).columns(PICTURE, CAMERA, LEVEL)


def _in_child(detector: OnnxDetector, answer: Any) -> None:
    answer.send_bytes(detector.columns(PICTURE, CAMERA, LEVEL).edge.tobytes())


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")  # that is what is tried
@pytest.mark.parametrize("threads", [1, 2])
def test_works_after_a_fork(tiny: Path, threads: int) -> None:
    detector = OnnxDetector(tiny, threads=threads)
    wanted = detector.columns(PICTURE, CAMERA, LEVEL).edge.tobytes()
    receive, send = multiprocessing.Pipe(duplex=False)
    child = multiprocessing.get_context("fork").Process(target=_in_child, args=(detector, send))
    child.start()
    try:
        assert receive.poll(60), "the forked process gave no answer in a minute"
        assert receive.recv_bytes() == wanted
        child.join(60)
        assert child.exitcode == 0
    finally:
        child.kill()
    assert detector.columns(PICTURE, CAMERA, LEVEL).edge.tobytes() == wanted


def test_missing_and_damaged_files(tmp_path: Path) -> None:
    whole = save_model(tmp_path / "whole.onnx").read_bytes()
    for name, data in {"text": b"not a model at all", "empty": b"", "cut": whole[: len(whole) // 2]}.items():
        path = tmp_path / f"{name}.onnx"
        path.write_bytes(data)
        with pytest.raises(GalocError, match=f"'{name}.onnx'.*cannot open"):
            OnnxDetector(path)
    with pytest.raises(GalocError, match="does not exist"):
        OnnxDetector(tmp_path / "nowhere.onnx")
    with pytest.raises(GalocError, match="folder"):
        OnnxDetector(str(tmp_path))
    with pytest.raises(GalocError, match="path"):
        OnnxDetector(7)  # type: ignore[arg-type]


def test_every_cut_of_a_file_is_refused_or_caught_by_its_sha256(tmp_path: Path) -> None:
    whole = save_model(tmp_path / "whole.onnx").read_bytes()
    digest = hashlib.sha256(whole).hexdigest()
    path = tmp_path / "cut.onnx"
    for length in np.linspace(0, len(whole) - 1, 40).astype(int):
        path.write_bytes(whole[:length])
        with pytest.raises(GalocError):
            OnnxDetector(path, sha256=digest)


def test_sha256(tiny: Path) -> None:
    digest = hashlib.sha256(tiny.read_bytes()).hexdigest()
    assert OnnxDetector(tiny).model.sha256 == digest
    assert OnnxDetector(tiny, sha256=digest.upper()).model.sha256 == digest
    with pytest.raises(GalocError, match=digest):
        OnnxDetector(tiny, sha256="0" * 64)
    with pytest.raises(GalocError, match="hexadecimal"):
        OnnxDetector(tiny, sha256="beef")


def test_the_shipped_model_is_checked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(assets, "root", lambda: tmp_path)
    with pytest.raises(GalocError, match="none ships"):
        OnnxDetector()
    path = tmp_path / SHIPPED
    path.parent.mkdir()
    save_model(path)
    for text in (None, "{", "[]", "{}", '{"sha256": 7}'):
        if text is not None:
            path.with_suffix(".json").write_text(text)
        with pytest.raises(GalocError, match=r"layout\.json"):
            OnnxDetector()
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    path.with_suffix(".json").write_text(json.dumps({"sha256": digest, "samples": 1}))
    assert OnnxDetector().model.sha256 == digest
    path.write_bytes(path.read_bytes() + b"\x00")
    with pytest.raises(GalocError, match="sha256"):
        OnnxDetector()


@pytest.mark.parametrize(
    ("contract", "words"), [(None, "another kind"), ("columns/2", "Update"), ("", "Update"), ("columns", "Update")]
)
def test_other_contracts(tmp_path: Path, contract: str | None, words: str) -> None:
    with pytest.raises(GalocError, match=words):
        OnnxDetector(save_model(tmp_path / "m.onnx", contract=contract))


def test_graphs_go_to_their_own_detector(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Graph:
        def __init__(self, *given: Any) -> None:
            self.given = given

        def detect(self, image: Any, camera: Camera, gravity: Any) -> Wireframe:
            return Wireframe([[1.0, 2.0]], [[1.0, 3.0]], [True], [True], np.zeros((0, 2), int))

    class Module:
        GraphDetector = Graph

    monkeypatch.setitem(sys.modules, "galoc.detect.graph", Module())
    detector = OnnxDetector(save_model(tmp_path / "m.onnx", contract="graph/1", leave_out=("edge",)))
    assert len(detector.detect(PICTURE, CAMERA, LEVEL)) == 1
    assert not detector.has_columns
    with pytest.raises(GalocError, match="graph/1"):
        detector.columns(PICTURE, CAMERA, LEVEL)
    assert check(detector, check_frames()[:2]).error_deg is None


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"leave_out": ("sure",)}, "without outputs"),
        ({"rename": {"edge": "edges"}}, "without outputs"),
        ({"channels": 6}, "'strip'.*shape"),
        ({"width": 240}, "'strip'.*shape"),
        ({"double": True}, r"'elevation'.*type tensor\(double\)"),
        ({"biases": {"visible": (0.5, 0.5, 0.5)}}, "'visible'.*shape"),
        ({"biases": {"elevation": (28.0, -23.0)}}, "'elevation'.*-23.*rad"),
        ({"biases": {"elevation": (float("nan"), -0.4)}}, "'elevation'.*nan"),
        ({"biases": {"sigma": (0.0, 0.1), "sure": (0.5, 0.5)}, "gain": 0.0}, "'sigma'"),
        ({"biases": {"in_frame": (0.5, 1.5)}}, "'in_frame'.*1.5"),
        ({"biases": {"edge": (-3.0, 0.5)}}, "'edge'.*-3"),
    ],
)
def test_networks_that_break_the_contract(tmp_path: Path, how: dict[str, Any], words: str) -> None:
    with pytest.raises(GalocError, match=words) as caught:
        OnnxDetector(save_model(tmp_path / "broken.onnx", **how))
    assert "broken.onnx" in str(caught.value)


def test_outputs_that_go_wrong_on_a_frame_name_the_model(tmp_path: Path) -> None:
    detector = OnnxDetector(save_model(tmp_path / "wild.onnx", gain=9.0, biases={"elevation": (0.5, -0.4)}))
    with pytest.raises(GalocError, match=r"wild\.onnx"):  # sound on the black strip of construction, not on a picture
        detector.columns(PICTURE, CAMERA, LEVEL)


def test_probabilities_are_clipped_of_rounding(tmp_path: Path) -> None:
    path = save_model(tmp_path / "m.onnx", gain=0.0, biases={"sure": (1.0005, -0.0005)})
    sure = OnnxDetector(path).columns(PICTURE, CAMERA, LEVEL).sure
    assert set(np.unique(sure)) == {0.0, 1.0}


@pytest.mark.parametrize("providers", [["NoSuchProvider"], [], "CPUExecutionProvider"])
def test_providers_that_are_not_there(tiny: Path, providers: Any) -> None:
    with pytest.raises(GalocError, match="providers.*CPUExecutionProvider"):
        OnnxDetector(tiny, providers=providers)


@pytest.mark.parametrize("threads", [0, -1, 1.5, True, "2"])
def test_threads_that_are_none(tiny: Path, threads: Any) -> None:
    with pytest.raises(GalocError, match="threads"):
        OnnxDetector(tiny, threads=threads)


def test_the_session_does_not_spin(tiny: Path) -> None:
    options = Model(tiny, threads=2).session.get_session_options()
    assert options.intra_op_num_threads == 2
    assert options.get_session_config_entry("session.intra_op.allow_spinning") == "0"


def test_reasons_are_one_short_line() -> None:
    assert reason(RuntimeError("[ONNXRuntimeError] : 7 : INVALID_PROTOBUF : Load failed.\nmore")) == "Load failed"
    assert reason(RuntimeError("")) == "RuntimeError"
    assert len(reason(RuntimeError("x" * 900))) <= 140


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (PICTURE.astype(np.uint16) * 257, "16 bits"),
        (PICTURE / 255.0, "255"),
        (PICTURE.astype(np.int64), "astype"),
        (PICTURE[..., 0], "grey"),
        (PICTURE[..., :1], "grey"),
        (np.dstack([PICTURE, PICTURE[..., :1]]), "alpha"),
        (np.moveaxis(PICTURE, -1, 0), "moveaxis"),
        (PICTURE[None], "one image"),
        (PICTURE[:40], "camera's"),
        (np.swapaxes(PICTURE, 0, 1), "rotated"),
        (np.zeros((0, 0, 3), np.uint8), "empty"),
        (np.zeros((0,), np.uint8), "empty"),
        (None, "array"),
        ([[1, 2], [3]], "GalocError|empty"),
        ("picture.png", "array"),
    ],
)
def test_images_that_are_none(tiny: Path, image: Any, words: str, decoder: Decoder) -> None:
    detector = OnnxDetector(tiny)
    for use in (detector.detect, detector.columns):
        with pytest.raises(GalocError, match=words):
            use(image, CAMERA, LEVEL)
    assert decoder.calls == []


@pytest.mark.parametrize("gravity", [(np.nan, 0.0), (0.0, np.radians(86.0)), (0.0,), (0.0, np.inf), None])
def test_gravity_that_is_none(tiny: Path, gravity: Any, decoder: Decoder) -> None:
    detector = OnnxDetector(tiny)
    for picture in (PICTURE, np.zeros_like(PICTURE)):
        for use in (detector.detect, detector.columns):
            with pytest.raises(GalocError, match="gravity"):
                use(picture, CAMERA, gravity)


@pytest.mark.parametrize("level", [0, 255, 90])
def test_pictures_of_one_tone_are_abstained_on(tiny: Path, level: int, decoder: Decoder) -> None:
    picture = np.full((72, 96, 3), level, np.uint8)
    assert len(OnnxDetector(tiny).detect(picture, CAMERA, LEVEL)) == 0 and decoder.calls == []


def test_one_pixel_is_abstained_on(tiny: Path) -> None:
    camera = Camera.from_hfov(1, 1, 70.0)
    assert len(OnnxDetector(tiny).detect(np.full((1, 1, 3), 9, np.uint8), camera, LEVEL)) == 0


def test_blank_means_nearly_one_tone_of_any_colour() -> None:
    tone = np.full((60, 90, 3), (200, 30, 90), np.uint8)
    assert is_blank(tone)
    tone[:20, :, 1] += 4
    assert is_blank(tone)  # a third of it is a little brighter
    tone[:20, :, 1] += 9
    assert not is_blank(tone)
    speck = np.zeros((480, 640, 3), np.uint8)
    speck[100:110, 200:210] = 255
    assert is_blank(speck)


def test_sound_pictures_are_not_copied_and_odd_ones_made_contiguous() -> None:
    assert checked_picture(PICTURE, CAMERA) is PICTURE
    mirrored = PICTURE[:, ::-1]
    checked = checked_picture(mirrored, CAMERA)
    assert checked.flags.c_contiguous and (checked == mirrored).all()


def test_check_passes_a_model_that_keeps_the_contract_and_says_what_it_is_worth(
    tiny: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("galoc.detect.decode")
    assert main(["detect", "--check", str(tiny)]) == 0
    out = capsys.readouterr().out
    assert "columns/1: passed" in out and "no better" in out


def test_check_fails_a_model_whose_rows_are_exchanged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("galoc.detect.decode")
    path = save_model(tmp_path / "m.onnx", biases={"elevation": (-0.4, 0.5)})
    try:
        code = main(["detect", "--check", str(path)])
    except GalocError:
        pytest.fail("an error of the decoder got through")
    captured = capsys.readouterr()
    assert code == 2 and ("FAILED" in captured.out or "elevation" in captured.err)


def test_check_fails_what_is_no_model(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "m.onnx").write_bytes(b"no model")
    assert main(["detect", "--check", str(tmp_path / "m.onnx")]) == 2
    captured = capfd.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1 and "m.onnx" in captured.err


def test_module_is_light() -> None:
    code = "import sys, galoc.detect.onnx; print('onnxruntime' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
