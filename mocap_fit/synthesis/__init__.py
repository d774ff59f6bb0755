"""Talking heads from text, sound or phones: alignment, text to speech, face parameters."""

from mocap_fit.synthesis.alignment import Aligner, align
from mocap_fit.synthesis.from_phones import Frame, stream_frames, synthesise, to_model_phones
from mocap_fit.synthesis.text_to_phones import SpokenText, TextSpeaker, speak_text

__all__ = [
    "Aligner",
    "Frame",
    "SpokenText",
    "TextSpeaker",
    "align",
    "speak_text",
    "stream_frames",
    "synthesise",
    "to_model_phones",
]
