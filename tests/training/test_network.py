"""Network, loss, trainer and export; skipped without the extra `train`."""

import json
import math

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs the extra `train` (torch)")

from galoc.detect.strip import ROWS, elevation_of  # noqa: E402
from training.evaluate import Residuals, fitted_calibration  # noqa: E402
from training.export import compare, export  # noqa: E402
from training.loss import inputs, losses, targets  # noqa: E402
from training.network import LayoutNet, Shape  # noqa: E402
from training.readout import KNOTS_DEG, NAMES, Readout  # noqa: E402
from training.stream import SHARD, Frames  # noqa: E402
from training.trainer import CHECKPOINT, Plan, Trainer, load_average  # noqa: E402

torch.set_num_threads(1)  # two threads on two busy cores wait for each other
TINY = Shape(stages=(4, 6, 8, 8), blocks=(1, 1, 1), lateral=(4, 6, 8), line=12)


def frames(count=4, columns=128, seed=0):
    rng = np.random.default_rng(seed)
    c = columns // 2
    edges = np.full((count, 32, 3), np.nan, np.float16)
    edges[:, 0] = (columns / 3, 0, 1)
    row = np.stack([np.full((count, c), 40.3), np.full((count, c), 90.6)], axis=1)
    return Frames(
        rng.integers(0, 256, (count, ROWS, columns, 3), dtype=np.uint8),
        np.full((count, ROWS, columns // 8), 255, np.uint8),
        row.astype(np.float16),
        np.full((count, 2, c), 2, np.uint8),
        edges,
        np.ones((count, ROWS // 2, c), np.uint8),
    )


@pytest.mark.parametrize("columns", [128, 176, 240])
def test_shapes(columns):
    outputs = LayoutNet(TINY)(torch.rand(2, 4, ROWS, columns))
    assert [tuple(o.shape) for o in outputs] == [
        (2, 2, ROWS, columns // 2), (2, 2, columns // 2), (2, 2, columns), (2, 9, ROWS // 2, columns // 2),
    ]  # fmt: skip


def test_shipped_shape_fits_eight_megabytes():
    parameters = sum(p.numel() for p in LayoutNet().parameters())
    assert 4 * parameters < 7.9e6


def test_loss_is_least_at_the_truth():
    wanted = targets(frames())
    right = torch.full((4, 2, ROWS, 64), -12.0)
    row = wanted.row
    low = row.floor().long()
    right.scatter_(2, low.unsqueeze(2), torch.log(1.0 - (row - low)).unsqueeze(2))
    right.scatter_(2, low.unsqueeze(2) + 1, torch.log(row - low).unsqueeze(2))
    rest = (torch.full((4, 2, 64), 8.0), torch.zeros(4, 2, 128), torch.zeros(4, 9, ROWS // 2, 64))
    best = losses((right, *rest), wanted)["boundary"]
    for shift in (-1, 1, 5):
        assert losses((right.roll(shift, 2), *rest), wanted)["boundary"] > best + 0.3


class _Said(torch.nn.Module):
    """A network that says one distribution everywhere."""

    def __init__(self, p, columns=32):
        super().__init__()
        self.logits = torch.log(torch.tensor(p, dtype=torch.float32)).reshape(1, 1, ROWS, 1).expand(1, 2, ROWS, columns)

    def forward(self, strip):
        c = self.logits.shape[3]
        b = len(strip)
        zeros = torch.zeros(b, 2, c), torch.zeros(b, 2, 2 * c), torch.zeros(b, 9, ROWS // 2, c)
        return self.logits.expand(b, 2, ROWS, c), *zeros


def test_readout_reads_a_distribution():
    p = np.full(ROWS, 1e-9)
    p[[30, 31]] = 0.25, 0.75
    p[100] = 0.2
    out = dict(zip(NAMES, Readout(_Said(p))(torch.ones(1, 4, ROWS, 64)), strict=True))
    expected = 0.25 * elevation_of(30) + 0.75 * elevation_of(31)
    assert float(out["elevation"][0, 0, 0]) == pytest.approx(float(expected), abs=1e-5)
    assert float(out["sure"][0, 0, 0]) == pytest.approx(1.0 / 1.2, abs=1e-4)
    assert float(out["in_frame"][0, 0, 0]) == pytest.approx(1.0, abs=1e-4)
    assert float(out["sigma"][0, 0, 0]) < math.radians(1.0)


def test_calibration_is_interpolated():
    p = np.full(ROWS, 1e-9)
    p[60] = 1.0
    values = np.array([KNOTS_DEG, KNOTS_DEG]) * 3.0
    raw, scaled = (Readout(_Said(p), c)(torch.ones(1, 4, ROWS, 64))[1] for c in (None, values))
    # A spread below the first knot is that knot's.
    assert float(raw[0, 0, 0]) == pytest.approx(math.radians(KNOTS_DEG[0]), rel=1e-3)
    assert float(scaled[0, 0, 0]) == pytest.approx(3.0 * math.radians(KNOTS_DEG[0]), rel=1e-3)


def test_fitted_calibration_finds_the_true_spread():
    rng = np.random.default_rng(0)
    stated = np.exp(rng.uniform(math.log(0.15), math.log(6.0), 60_000))
    error = 1.5 * stated * rng.standard_normal(len(stated))
    ones = np.ones(len(stated))
    fitted = fitted_calibration(Residuals(error, stated, ones, 2 * ones, ones))[0]
    inner = slice(1, 7)  # errors of 12 degrees and more are no spread
    assert np.allclose(fitted[inner] / np.array(KNOTS_DEG)[inner], 1.5, rtol=0.12)


def test_mirrored_pictures_are_read_alike():
    torch.manual_seed(1)
    readout = Readout(LayoutNet(TINY).eval())
    strip = torch.rand(1, 4, ROWS, 128)
    with torch.no_grad():
        one, other = readout(strip), readout(strip.flip(3))
    for a, b in zip(one, other, strict=True):
        assert torch.allclose(a, b.flip(2), atol=1e-5)


def test_exported_model_says_what_the_network_says(tmp_path):
    pytest.importorskip("onnx")
    pytest.importorskip("onnxscript")
    import warnings

    torch.manual_seed(0)
    readout = Readout(LayoutNet(TINY).eval(), np.array([KNOTS_DEG, KNOTS_DEG])).eval()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the exporter's own making
        export(readout, tmp_path / "tiny.onnx", {"why": "test"})
    assert compare(readout, tmp_path / "tiny.onnx") < 1e-3
    raw = (tmp_path / "tiny.onnx").read_bytes()
    assert b"site-packages" not in raw and str(tmp_path.parent).encode() not in raw

    from galoc.detect.onnx import OnnxDetector

    detector = OnnxDetector(tmp_path / "tiny.onnx")
    assert json.loads(detector.model.metadata["galoc.facts"]) == {"why": "test"}


def test_training_goes_on_where_it_stopped(tmp_path):
    shards = tmp_path / "shards"
    shards.mkdir()
    few = frames(8)
    Frames.joined([few] * (SHARD // 8)).save(shards / "w128-00-1.npz")
    plan = Plan(minutes=10.0, batch=4)
    first = Trainer(tmp_path, shards, plan, TINY)
    for _ in range(3):
        first._step()
    first.save()
    second = Trainer(tmp_path, shards, plan)
    assert second.steps == 3 and second.shape == TINY
    for name, value in first.net.state_dict().items():
        assert torch.equal(value, second.net.state_dict()[name]), name
    second._step()
    second.save()
    net, facts = load_average(tmp_path / CHECKPOINT)
    assert facts["steps"] == 4 and facts["frames"] == 16
    assert not any(p.suffix == ".part" for p in tmp_path.iterdir())
    assert all(torch.isfinite(p).all() for p in net.parameters())


def test_training_learns(tmp_path):
    """Fifty steps on eight frames: the boundary is found to a row, which no untrained network does."""
    few = frames(8)
    torch.manual_seed(0)
    net = LayoutNet(TINY)
    optimizer = torch.optim.AdamW(net.parameters(), lr=1e-2)
    wanted, strip = targets(few), inputs(few)
    for _ in range(50):
        parts = losses(net(strip), wanted)
        optimizer.zero_grad()
        (parts["boundary"] + parts["visible"]).backward()
        optimizer.step()
    assert float(parts["rows_off"]) < 1.0
