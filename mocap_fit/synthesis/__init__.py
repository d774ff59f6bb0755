"""From text and sound to labelled phones: forced alignment, and text to speech."""

from mocap_fit.synthesis.alignment import Aligner, align
from mocap_fit.synthesis.from_phones import Frame, phones_for, stream_frames, synthesise
from mocap_fit.synthesis.text_to_phones import SpokenText, TextSpeaker, speak_text

__all__ = [
    "Aligner",
    "Frame",
    "SpokenText",
    "TextSpeaker",
    "align",
    "phones_for",
    "speak_text",
    "stream_frames",
    "synthesise",
]
