"""From text and sound to labelled phones: forced alignment, and text to speech."""

from mocap_fit.synthesis.alignment import Aligner, align
from mocap_fit.synthesis.text_to_phones import SpokenText, TextSpeaker, speak_text

__all__ = ["Aligner", "SpokenText", "TextSpeaker", "align", "speak_text"]
