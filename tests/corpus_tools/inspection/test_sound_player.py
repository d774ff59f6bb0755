"""What is heard: a stretch of the sound, then silence while time goes on."""

import numpy as np

from corpus_tools.inspection.sound_player import SoundPlayer
from mocap_fit.sound import Sound


def test_a_stretch_is_filled_block_by_block():
    samples = np.column_stack([np.arange(100.0), np.arange(100.0) + 2]) / 200
    player = SoundPlayer(Sound(samples, 1000.0))
    # The stream would ask for blocks; without a device the blocks are asked for here.
    player.play(0.02, 0.05)
    player._index, player._stop = 20, 50
    blocks = []
    for _ in range(3):
        block = np.full((20, 1), np.nan)
        player._fill(block, 20, None, None)
        blocks.append(block[:, 0])
    samples = np.concatenate(blocks)
    np.testing.assert_allclose(samples[:30], (np.arange(20, 50) + 1) / 200)
    assert (samples[30:] == 0).all()
    player.stop()


def test_without_sound_nothing_plays():
    player = SoundPlayer(None)
    player.play(0.0, 1.0)
    assert player.position is None
