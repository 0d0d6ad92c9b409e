"""Loads the policy beside this file and acts on one observation: python3 act.py

Needs numpy and safetensors. Nothing in the file is executed.
"""

import json
import math
import pathlib

import numpy as np
from safetensors.numpy import load_file

FOLDER = pathlib.Path(__file__).resolve().parent
MANIFEST = json.loads((FOLDER / "manifest.json").read_text(encoding="utf-8"))

ACTIVATIONS = {
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0),
    "silu": lambda x: x / (1 + np.exp(-x)),
    "gelu": lambda x: x * 0.5 * (1 + np.vectorize(math.erf)(x * math.sqrt(0.5))),
}


class Policy:
    """Observations [B, size] float32 -> logits [B, 27] or means [B, 3]."""

    def __init__(self):
        self.tensors = load_file(FOLDER / MANIFEST["file"])
        self.architecture = MANIFEST["architecture"]

    def normalised(self, x):
        limit = self.architecture["normalized_limit"]
        x = (x - self.tensors["observation.mean"]) / self.tensors["observation.std"]
        return np.clip(x, -limit, limit)

    def layer_norm(self, x, name):
        centred = x - x.mean(-1, keepdims=True)
        variance = (centred**2).mean(-1, keepdims=True)
        x = centred / np.sqrt(variance + self.architecture["layer_norm_epsilon"])
        return x * self.tensors[name + "norm_weight"] + self.tensors[name + "norm_bias"]

    def __call__(self, obs):
        x = network_input(obs)
        x = self.normalised(x) if self.architecture["normalizes_observations"] else x
        n_hidden = len(self.architecture["hidden"])
        for k in range(n_hidden + 1):
            name = f"layers.{k}."
            x = x @ self.tensors[name + "weight"].T + self.tensors[name + "bias"]
            if k < n_hidden:
                x = self.layer_norm(x, name) if self.architecture["layer_norm"] else x
                x = ACTIVATIONS[self.architecture["activation"]](x)
        return x.astype(np.float32)
