"""Writes a checkpoint as an ONNX file of contract ``columns/1``: ``python -m training.export --out runs/training``."""

from __future__ import annotations

import hashlib
import json
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro

from galoc.detect.strip import BLOCK, MOST_COLUMNS, ROWS
from galoc.formats.atomic import write_atomic
from training.evaluate import fitted_calibration, measure, validation
from training.readout import NAMES, Readout
from training.trainer import CHECKPOINT, load_average

CONTRACT = "columns/1"
OPSET = 18


@dataclass(frozen=True, slots=True)
class Options:
    """Export the averaged network of a checkpoint, with its spreads calibrated on validation homes."""

    out: Path = Path("runs/training")
    """Folder of the training run."""
    model: Path = Path("assets/models/layout.onnx")
    """What to write; its facts go beside it as JSON."""
    frames: int = 1500
    """Validation frames for the calibration."""


def export(readout: Readout, path: Path, facts: dict[str, Any]) -> None:
    """Write the file, without anything of the machine it was made on.

    Args:
        readout: the network, on the CPU.
        path: of the file.
        facts: go into its metadata, as JSON.
    """
    import onnx

    strip = torch.rand(1, 4, ROWS, MOST_COLUMNS)
    block = torch.export.Dim("block", min=4, max=MOST_COLUMNS // BLOCK)
    program = torch.onnx.export(
        readout.eval(),
        (strip,),
        dynamo=True,
        opset_version=OPSET,
        input_names=["strip"],
        output_names=list(NAMES),
        dynamic_shapes={"strip": {3: BLOCK * block}},
        verbose=False,
    )
    with tempfile.TemporaryDirectory() as folder:
        raw = Path(folder) / "raw.onnx"
        program.save(str(raw), external_data=False)
        model = onnx.load(str(raw))
    _stripped(model)
    for key, value in {"galoc.contract": CONTRACT, "galoc.facts": json.dumps(facts, sort_keys=True)}.items():
        entry = model.metadata_props.add()
        entry.key, entry.value = key, value
    onnx.checker.check_model(model)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, model.SerializeToString())


def _stripped(model: Any) -> None:
    """Remove what the exporter notes down of the source code, with local paths, and name the axes."""
    del model.metadata_props[:]
    model.doc_string, model.producer_version = "", ""
    graph = model.graph
    graph.doc_string = ""
    for node in graph.node:
        del node.metadata_props[:]
        node.doc_string = ""
    for value in [*graph.value_info, *graph.input, *graph.output, *graph.initializer]:
        del value.metadata_props[:]
        value.doc_string = ""
    del graph.value_info[:]
    for function in model.functions:
        del function.metadata_props[:]


def compare(readout: Readout, path: Path) -> float:
    """Largest difference between torch and onnxruntime over all outputs and several widths."""
    import onnxruntime

    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    worst = 0.0
    for blocks in (5, 9, 14, 15):
        torch.manual_seed(blocks)
        strip = torch.rand(1, 4, ROWS, BLOCK * blocks)
        with torch.no_grad():
            wanted = readout(strip)
        found = session.run(list(NAMES), {"strip": strip.numpy()})
        worst = max(worst, *(float(np.abs(w.numpy() - f).max()) for w, f in zip(wanted, found, strict=True)))
    return worst


def main(options: Options) -> None:
    """Calibrate, measure, export, compare."""
    torch.set_num_threads(1)
    net, facts = load_average(options.out / CHECKPOINT)
    frames = validation(options.out, options.frames)
    _, residuals = measure(Readout(net), frames)
    calibration = fitted_calibration(residuals)
    readout = Readout(net, calibration)
    metrics, _ = measure(readout, frames)
    facts |= {"minutes": round(facts.pop("seconds") / 60.0, 1), "licence": "MIT", "validation": metrics}
    parameters = sum(p.numel() for p in net.parameters())
    facts |= {"parameters": parameters, "contract": CONTRACT}
    export(readout, options.model, facts)
    digest = hashlib.sha256(options.model.read_bytes()).hexdigest()
    beside = {"sha256": digest, **facts}
    write_atomic(options.model.with_suffix(".json"), (json.dumps(beside, indent=1, sort_keys=True) + "\n").encode())
    difference = compare(readout, options.model)
    print(f"{options.model}  {options.model.stat().st_size / 1e6:.2f} MB  onnxruntime against torch: {difference:.2e}")
    if difference > 1e-3:
        raise SystemExit("The exported model says something else than the network.")


if __name__ == "__main__":
    main(tyro.cli(Options))
