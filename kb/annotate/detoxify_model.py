"""A verified checkpoint through Detoxify's own code, without asking any host.

Detoxify resolves the base model's name in the checkpoint ("bert-base-uncased") at the model hub
even when it is given a local folder, and reads the number of outputs from that folder's
config.json, where a base model has none. Both are set here before Detoxify sees them.
A model may have more outputs than classes (`unbiased`: 16 and 7); the first ones are its classes.
Source: https://github.com/unitaryai/detoxify/blob/v0.5.4/detoxify/detoxify.py
"""

import contextlib
import hashlib
import json
import logging
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from kb.core.errors import MissingModel
from kb.core.installation import mock
from kb.core.regular_file import open_regular
from kb.store.checkpoint import Checkpoint, need_extra, tokenizer_files
from kb.store.exhausted import is_out_of_memory

WINDOW = 512  # tokens that every published model reads at once


def load_detoxify(checkpoint: Checkpoint, device: str = "cpu") -> Any:
    """The `detoxify.Detoxify` object of a verified checkpoint, in evaluation mode.

    Raises MissingExtra, and MissingModel when the file is not a Detoxify checkpoint.
    """
    need_extra()
    with _quiet():
        import detoxify.detoxify as source

        try:
            loaded = _read(checkpoint, device)
            arguments = loaded["config"]["arch"]["args"]
            outputs, classes = (
                int(arguments["num_classes"]),
                loaded["config"]["dataset"]["args"]["classes"],
            )
            # Weights in halves are widened: the graph and its runners compute in fp32.
            state = {
                name: value.float() if value.is_floating_point() else value
                for name, value in loaded["state_dict"].items()
            }
            loaded["state_dict"] = state
            if not 0 < len(classes) <= outputs:
                raise ValueError("classes")
        except MissingModel:
            raise
        except Exception as error:  # whatever unpickling a foreign file may raise
            if is_out_of_memory(error):
                raise
            raise MissingModel(
                f"{checkpoint.path} is not a Detoxify checkpoint ({type(error).__name__})",
                hint="KB_TOXICITY_MODEL must be a Detoxify model name or checkpoint;"
                " see `kb models fetch`",
            ) from error
        with _local_folder(checkpoint.folder, outputs) as folder:
            arguments["model_type"] = str(folder)
            try:
                # Detoxify reads the file itself; it gets what was verified and is read already.
                with mock.patch.object(source.torch, "load", return_value=loaded):
                    model = source.Detoxify(
                        checkpoint=str(checkpoint.path),
                        device=device,
                        huggingface_config_path=str(folder),
                    )
            except Exception as error:  # whatever a foreign configuration makes transformers raise
                if is_out_of_memory(error):
                    raise
                why = (str(error).strip().splitlines() or [type(error).__name__])[0]
                if "ignore_mismatched_sizes" in why:
                    why = "its weights have other shapes"
                raise _misfit(checkpoint, why) from error
        if len(model.tokenizer) > model.model.config.vocab_size:
            raise _misfit(
                checkpoint,
                f"the tokenizer has {len(model.tokenizer)} tokens,"
                f" the model knows {model.model.config.vocab_size}",
            )
        _same_weights(model, state, checkpoint)
    if "toxicity" not in model.class_names:
        raise MissingModel(
            f"{checkpoint.path} has no class 'toxicity', only"
            f" {', '.join(map(str, model.class_names))[:80]}",
            hint="KB_TOXICITY_MODEL must be a Detoxify model name or checkpoint;"
            " see `kb models fetch`",
        )
    model.model.eval()
    return model


def _read(checkpoint: Checkpoint, device: str) -> Any:
    """What the file holds: tensors and plain values, nothing that runs.

    Verified once more on the open file: it may have been replaced since it was found, or be another
    machine's. Raises MissingModel for that, and what torch raises for a file that it has
    not written.
    """
    import torch

    with open_regular(checkpoint.path) as file:
        if hashlib.file_digest(file, "sha256").hexdigest() != checkpoint.sha256:
            raise MissingModel(
                f"{checkpoint.path} was changed after it was verified",
                hint="download the file again",
            )
        file.seek(0)
        # Detoxify's files hold a dictionary of JSON values and one of tensors: this is enough.
        return torch.load(file, map_location=device, weights_only=True)


@contextlib.contextmanager
def _local_folder(source_folder: Path, outputs: int) -> Iterator[Path]:
    """A folder with the tokenizer's files and a config.json that knows the number of outputs."""
    config = json.loads((source_folder / "config.json").read_text(encoding="utf-8"))
    config |= {
        "num_labels": outputs,
        "id2label": {str(n): f"LABEL_{n}" for n in range(outputs)},
        "label2id": {f"LABEL_{n}": n for n in range(outputs)},
    }
    with tempfile.TemporaryDirectory(prefix="kb-model-") as name:
        folder = Path(name)
        (folder / "config.json").write_text(json.dumps(config), encoding="utf-8")
        for file in tokenizer_files(source_folder):
            shutil.copyfile(file, folder / file.name)
        path = folder / "tokenizer_config.json"
        options = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        options["model_max_length"] = min(WINDOW, options.get("model_max_length") or WINDOW)
        path.write_text(json.dumps(options), encoding="utf-8")
        yield folder


def _same_weights(model: Any, state: dict[str, Any], checkpoint: Checkpoint) -> None:
    """transformers fills a missing weight with random numbers and only warns: that is no model."""
    import torch

    broken = [
        name
        for name, value in state.items()
        if value.is_floating_point() and not bool(torch.isfinite(value).all())
    ]
    if broken:
        raise MissingModel(
            f"{checkpoint.path} is broken: {broken[0]} contains values that are not numbers",
            hint="download the file again",
        )
    own = model.model.state_dict()
    wrong = [name for name in own if name not in state and not name.endswith("position_ids")]
    wrong += [
        name
        for name, value in state.items()
        if name in own and not torch.equal(own[name].cpu(), value.cpu())
    ]
    if wrong:
        raise _misfit(checkpoint, f"{wrong[0]} differs")


def _misfit(checkpoint: Checkpoint, why: str) -> MissingModel:
    return MissingModel(
        f"{checkpoint.path} does not match its config.json: {why}",
        hint="put the config.json and tokenizer of its base model into its folder",
    )


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """No progress bars and no hub: everything is on this machine."""
    before = {
        name: os.environ.get(name)
        for name in ("HF_HUB_OFFLINE", "TRANSFORMERS_VERBOSITY", "TOKENIZERS_PARALLELISM")
    }
    os.environ |= {
        "HF_HUB_OFFLINE": "1",
        "TRANSFORMERS_VERBOSITY": "error",
        "TOKENIZERS_PARALLELISM": "true",
    }
    try:
        import transformers

        transformers.utils.logging.set_verbosity_error()
        transformers.utils.logging.disable_progress_bar()
        logging.getLogger("transformers").setLevel(logging.ERROR)
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.__setitem__(name, value)
