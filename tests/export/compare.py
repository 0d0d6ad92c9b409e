"""compare.py FOLDER LIMIT: whether the exports in a folder give the numbers that gigastep's own actors gave.

FOLDER has obs.f32 (observations, raw float32), and for each export NAME/ the outputs NAME.f32; of one that takes images
these are in NAME.u8. By how much outputs may differ is LIMIT, or what NAME.limit.f32 says of each. Exit code 1 where a
number differs by more or an export is not what its manifest says, 77 where a Python package is missing.
"""

import importlib.util
import json
import pathlib
import sys
import warnings

warnings.simplefilter("ignore")  # PyTorch's, about the format


def load_example(folder):
    """act.py of an export, as a module."""
    spec = importlib.util.spec_from_file_location(f"act_{folder.name}", folder / "act.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def check_onnx(folder, manifest):
    """What ONNX's own checker finds, and the names and sizes that programs rely on."""
    import onnx

    model = onnx.load(folder / manifest["file"])
    onnx.checker.check_model(model, full_check=True)
    assert model.opset_import[0].version >= 17, model.opset_import
    values = {v.name: [d.dim_param or d.dim_value for d in v.type.tensor_type.shape.dim]
              for v in [*model.graph.input, *model.graph.output]}
    seen = manifest["observation"]
    expected = {seen["input"]: ["batch", *seen.get("shape", [seen["size"]])],
                manifest["action"]["output"]: ["batch", manifest["action"]["size"]]}
    state = manifest["state"]
    if state["size"] > 0:
        expected |= {state["input"]: ["batch", state["size"]], state["output"]: ["batch", state["size"]]}
    assert values == expected, values


def check_torchscript(folder, manifest):
    """Its tensors are fp32 buffers."""
    import torch

    buffers = dict(torch.jit.load(folder / manifest["file"]).named_buffers())
    assert "layers_0_weight" in buffers, buffers
    assert all(b.dtype == torch.float32 for b in buffers.values()), buffers


def check_actions(example, manifest, head):
    """The example's actions are of the right kind: greedy ones, drawn ones with the right frequencies, and none drawn
    where the policy is greedy."""
    import numpy as np

    random = np.random.default_rng(1)
    if manifest["action_selection"] == "greedy":
        assert all(np.array_equal(example.act(head, random), example.act(head)) for _ in range(100))
        return
    if manifest["action"]["kind"] == "discrete":
        assert example.act(head) == head.argmax()
        n = 4000
        drawn = np.bincount([example.act(head, random) for _ in range(n)], minlength=head.size) / n
        wanted = np.exp(head - head.max()) / np.exp(head - head.max()).sum()
        assert abs(drawn - wanted).max() < 5 * 0.5 / n**0.5, (drawn, wanted)  # 5 deviations of the widest share
    else:
        assert np.allclose(example.act(head), np.tanh(head))
        assert example.act(head, random).shape == (3,)


def third_head(example, policy, obs):
    """What comes out at the third step in which the agents see the same."""
    state = example.start(len(obs))
    for _ in range(3):
        head, state = policy.step(obs, state)
    return head


ALONE = 64  # observations that are tried one by one as well


def compare(folder, obs, limit):
    """The largest difference of an export's outputs, together and row by row, as a share of what it may be."""
    import numpy as np

    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    if manifest["observation"]["type"] == "uint8":
        images = np.fromfile(folder.with_name(folder.name + ".u8"), np.uint8)
        obs = images.reshape(-1, *manifest["observation"]["shape"])
    else:
        obs = obs.reshape(-1, manifest["observation"]["size"])
    expected = np.fromfile(folder.with_name(folder.name + ".f32"), np.float32).reshape(len(obs), -1)
    assert expected.shape[1] == manifest["action"]["size"], expected.shape
    example = load_example(folder)
    policy = example.Policy()
    together = third_head(example, policy, obs)
    alone = np.concatenate([third_head(example, policy, row[None]) for row in obs[:ALONE]])
    assert together.dtype == np.float32 and together.shape == expected.shape, (together.dtype, together.shape)
    {"onnx": check_onnx, "torchscript": check_torchscript}.get(manifest["format"], lambda *_: None)(folder, manifest)
    check_actions(example, manifest, expected[0])
    head, state = policy.step(example.example_observation(), example.start(1))
    assert head.shape == (1, manifest["action"]["size"]) and state.shape == (1, manifest["state"]["size"])
    limits = np.full_like(expected, limit)
    if (own := folder.with_name(folder.name + ".limit.f32")).exists():
        limits = np.fromfile(own, np.float32).reshape(expected.shape)
    return max((abs(together - expected) / limits).max(), (abs(alone - expected[:ALONE]) / limits[:ALONE]).max())


def main():
    root, limit = pathlib.Path(sys.argv[1]), float(sys.argv[2])
    try:
        import numpy as np

        obs = np.fromfile(root / "obs.f32", np.float32)
        folders = sorted(path.parent for path in root.glob("*/manifest.json"))
        differences = {folder.name: compare(folder, obs, limit) for folder in folders}
    except ImportError as error:
        print(error)
        sys.exit(77)
    far = {name: difference for name, difference in differences.items() if not difference <= 1}
    for name, difference in far.items():
        print(f"{name}: differs by {difference} times what it may")
    print(f"{len(differences) - len(far)} policies agree, the farthest within {max(differences.values())} of the limit")
    sys.exit(1 if far else 0)


main()
