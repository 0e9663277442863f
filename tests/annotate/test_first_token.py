"""The shortened last layer: the numbers of the whole model,
for each of Detoxify's architectures.
"""

from __future__ import annotations

import pytest

from kb.annotate.first_token import shorten, shortened
from tests.conftest import needs

needs("torch", "transformers")


SIZES = {
    "num_labels": 3,
    "vocab_size": 50,
    "hidden_size": 24,
    "num_hidden_layers": 2,
    "num_attention_heads": 3,
    "intermediate_size": 32,
    "max_position_embeddings": 40,
    "initializer_range": 0.5,
}


@pytest.fixture
def torch():
    import torch

    return torch


@pytest.fixture
def batch(torch):
    ids = torch.arange(3, 3 + 4 * 9).reshape(4, 9) % 47 + 3
    mask = torch.ones_like(ids)
    mask[1, 5:] = 0
    mask[2, 1:] = 0
    return {"input_ids": ids, "attention_mask": mask}


def model_of(name: str, **more):
    import torch
    import transformers

    torch.manual_seed(3)
    config = getattr(transformers, f"{name}Config")(**{**SIZES, **more})
    return getattr(transformers, f"{name}ForSequenceClassification")(config).eval()


@pytest.mark.parametrize("name", ["Bert", "Roberta", "XLMRoberta"])
def test_same_logits_from_fewer_tokens(torch, name, batch):
    model = model_of(name)
    with torch.inference_mode():
        whole = model(**batch).logits
        unmasked = model(input_ids=batch["input_ids"]).logits
        with shortened(model):
            short = model(**batch, output_hidden_states=False).logits
            last = model.base_model(**batch).last_hidden_state
            assert torch.allclose(model(input_ids=batch["input_ids"]).logits, unmasked, atol=1e-6)
        after = model.base_model(**batch).last_hidden_state
    assert torch.allclose(short, whole, atol=1e-6)
    assert whole.std() > 0.01, "a model that says the same of every text shows nothing"
    assert last.shape[1] == 1, "the last layer computed all tokens"
    assert after.shape[1] == 9, "the model stayed shortened"


def test_a_model_of_another_layout_stays_as_it_is(torch, batch):
    model = model_of("Albert", embedding_size=8)
    with torch.inference_mode():
        whole = model(**batch).logits
        assert shorten(model) is None
        assert torch.equal(model(**batch).logits, whole)
