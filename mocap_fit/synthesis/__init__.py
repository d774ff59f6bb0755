"""Talking heads from text, sound or phones: alignment, text to speech, face parameters."""

from mocap_fit.synthesis.alignment import Aligner as Aligner
from mocap_fit.synthesis.alignment import align as align
from mocap_fit.synthesis.from_phones import Frame as Frame
from mocap_fit.synthesis.from_phones import stream_frames as stream_frames
from mocap_fit.synthesis.from_phones import synthesise as synthesise
from mocap_fit.synthesis.from_phones import to_model_phones as to_model_phones
from mocap_fit.synthesis.text_to_phones import SpokenText as SpokenText
from mocap_fit.synthesis.text_to_phones import TextSpeaker as TextSpeaker
from mocap_fit.synthesis.text_to_phones import speak_text as speak_text
