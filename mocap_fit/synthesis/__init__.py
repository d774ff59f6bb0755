"""From text and sound to labelled phones: forced alignment."""

from mocap_fit.synthesis.alignment import Aligner, align

__all__ = ["Aligner", "align"]
