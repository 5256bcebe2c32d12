from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from hadr.rivals.tode import TODEConfig, TODETrans, _Enlarge, fuse_levels

SMALL = TODEConfig(embed_dim=8, depths=(2, 1, 1), heads=(1, 2, 4), window=4, width=16)


@pytest.fixture(scope="module")
def network() -> TODETrans:
    torch.manual_seed(0)
    return TODETrans(SMALL).eval()


@pytest.fixture(scope="module")
def published() -> TODETrans:
    torch.manual_seed(0)
    return TODETrans().eval()


def test_it_has_the_published_number_of_weights(published: TODETrans) -> None:
    count = sum(values.numel() for values in published.parameters())
    assert count == pytest.approx(4.9e6, rel=0.05)
    never_used = 2 * 192 + 193 * 1000  # last layer normalisation, classifier of 1000 classes
    assert count + never_used == pytest.approx(4.9e6, rel=0.01)


def test_every_weight_takes_part(network: TODETrans, noise_frames) -> None:
    model = TODETrans(SMALL)
    model.load_state_dict(network.state_dict())
    model(noise_frames()).image.sum().backward()
    assert [name for name, values in model.named_parameters() if values.grad is None] == []


def test_the_published_size_and_large_patches_give_an_image(published, noise_frames):
    large = TODETrans(replace(SMALL, patch=4)).eval()
    with torch.no_grad():
        assert published(noise_frames(72, 128)).image.shape == (2, 72, 128)
        assert large(noise_frames(22, 34)).image.shape == (2, 22, 34)


def test_the_transformer_is_given_colour_and_metres_as_they_are(network, noise_frames):
    inputs = noise_frames()
    seen: list[torch.Tensor] = []
    hook = network.swin.register_forward_pre_hook(lambda _, given: seen.append(given[0]))
    with torch.no_grad():
        network(inputs)
    hook.remove()
    assert torch.equal(seen[0], torch.cat((inputs.color, inputs.depth[:, None]), dim=1))


def test_depth_beyond_ten_metres_is_missing(network: TODETrans, noise_frames) -> None:
    inputs = noise_frames()
    far, none = inputs.depth.clone(), inputs.depth.clone()
    far[:, :3], none[:, :3] = 10.5, 0
    with torch.no_grad():
        expected = network(replace(inputs, depth=none)).image
        assert torch.equal(network(replace(inputs, depth=far)).image, expected)


def test_a_frame_without_any_depth_gives_numbers(network: TODETrans, noise_frames) -> None:
    inputs = replace(noise_frames(), depth=torch.zeros(2, 18, 32))
    model = TODETrans(SMALL)
    model.load_state_dict(network.state_dict())
    for mode in (True, False):
        output = model.train(mode)(inputs)
        assert torch.isfinite(output.image).all()
        output.image.sum().backward()
    grads = [values.grad for values in model.parameters()]
    assert all(torch.isfinite(grad).all() for grad in grads if grad is not None)


def test_where_the_answer_is_not_positive_nothing_is_restored(noise_frames) -> None:
    model = TODETrans(SMALL).eval()
    torch.nn.init.constant_(model.head[3].bias, -1e3)
    output = model(noise_frames())
    assert not output.restored.any()
    assert output.depth.abs().max() == 0


def test_levels_pass_the_finer_ones_mean_by_hand() -> None:
    fine = torch.tensor([[1.0, 3.0], [5.0, 7.0], [2.0, 4.0]])  # 3 x 2
    stages = [
        torch.stack((fine, fine + 2))[None],  # (1, 2, 3, 2); its channels' mean: fine + 1
        torch.tensor([10.0, -10.0]).view(1, 1, 2, 1),
        torch.ones(1, 1, 1, 1),
    ]
    # (2 + 4 + 6 + 8) / 4 = 5 opens the upper pixel, (3 + 5) / 2 = 4 the lower one
    first, second, third = fuse_levels(stages, gate=1.0)
    assert torch.equal(first, stages[0])
    assert second.flatten().tolist() == [50, -40]
    assert third.item() == 5  # (50 - 40) / 2 from the fused level, not from the bare one
    half = fuse_levels(stages, gate=0.5)
    assert half[1].flatten().tolist() == [30, -25]
    assert fuse_levels(stages, gate=0.0)[1].flatten().tolist() == [10, -10]


def test_stages_are_not_normalised_else_their_gates_were_shut(published: TODETrans) -> None:
    with torch.no_grad():
        stages = published.swin(torch.rand(1, 4, 32, 32)).feature_maps
    assert [tuple(stage.shape[1:]) for stage in stages] == [
        (24, 16, 16),
        (48, 8, 8),
        (96, 4, 4),
        (192, 2, 2),
    ]
    # A layer normalisation would leave a mean of about 1e-8.
    assert all(stage.mean(dim=1).abs().max() > 1e-4 for stage in stages)


def test_a_layer_enlarges_each_pixel_adds_the_identity_and_damps() -> None:
    layer = _Enlarge(channels=2, out=3, factor=2).eval()
    torch.nn.init.zeros_(layer.refine[4].weight)  # the convolutions' share: 0
    torch.nn.init.ones_(layer.enlarge.weight)
    torch.nn.init.zeros_(layer.enlarge.bias)
    values = torch.tensor([[1.0, 2.0], [3.0, -4.0]]).expand(1, 2, 2, 2)
    grown = layer(values, (3, 4))
    damped = (1 + 3) ** -0.5  # variance 1 and as much as there are channels
    row = torch.tensor([2.0, 2.0, 4.0, 4.0]) * damped
    last = torch.tensor([6.0, 6.0, 0.0, 0.0]) * damped
    torch.testing.assert_close(grown, torch.stack((row, row, last)).expand(1, 3, 3, 4))


def test_normalisations_chance_and_activations_are_published_ones(published: TODETrans) -> None:
    norms = [m.eps for m in published.modules() if isinstance(m, torch.nn.BatchNorm2d)]
    assert norms == [1e-5, 1e-5, 128] * 3 + [1e-5, 1e-5, 64, 64]
    dropped = [m for m in published.modules() if type(m).__name__ == "SwinDropPath"]
    rates = [m.drop_prob for m in dropped]
    assert rates == pytest.approx([0.1 * block / 11 for block in range(1, 12)])
    assert published.swin.config.hidden_act == "relu"
