"""espeak-ng in a separate process, because it is a GPL program.

Run as a script, it reads a request from its input, as JSON, and writes a line of JSON and, after
it, samples of 16 bits. A process speaks one text, because what espeak-ng spoke before influences
what it speaks next. It imports nothing of mocap-fit, whose `mocap_fit.synthesis.text_to_phones`
starts it.

Request: ``{"voice": "sv", "text": "...", "speed": 160}``.
Answer: ``{"rate": 22050, "samples": 48962, "events": [[kind, sample, position, length, name],
...], "is_cut": false}`` or ``{"error": "voice", "voices": [...]}``. The kinds are ``word``
(position and length count characters, from 1) and ``phone`` (its name is IPA, with stress before
it; none is a pause). Speech is cut after an hour.
"""

from __future__ import annotations

import ctypes
import json
import sys
from typing import Any

_RETRIEVAL = 2
_PHONE_EVENTS, _IPA = 1, 2
_WORD, _PHONE = 1, 7
_UTF8 = 1
_SPEED = 1
# Seconds.
_LONGEST = 3600


class _Identifier(ctypes.Union):
    _fields_ = (("number", ctypes.c_int), ("string", ctypes.c_char * 8))


class _Event(ctypes.Structure):
    _fields_ = (
        ("type", ctypes.c_int),
        ("unique_identifier", ctypes.c_uint),
        ("text_position", ctypes.c_int),
        ("length", ctypes.c_int),
        ("audio_position", ctypes.c_int),
        ("sample", ctypes.c_int),
        ("user_data", ctypes.c_void_p),
        ("identifier", _Identifier),
    )


class _VoiceRecord(ctypes.Structure):
    _fields_ = (
        ("name", ctypes.c_char_p),
        # Tags one after another, a byte of priority before each, and a zero byte at the end.
        ("languages", ctypes.c_void_p),
        ("identifier", ctypes.c_char_p),
    )


_Callback = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.POINTER(ctypes.c_short), ctypes.c_int, ctypes.POINTER(_Event)
)


def _read_identifier(event: _Event) -> bytes:
    # Not `identifier.string`, which ends at a zero byte but may fill all eight.
    raw = ctypes.string_at(ctypes.addressof(event.identifier), 8)
    return raw.split(b"\0")[0]


def _load_library() -> Any:
    import espeakng_loader

    library = ctypes.CDLL(espeakng_loader.get_library_path())
    library.espeak_ListVoices.restype = ctypes.POINTER(ctypes.POINTER(_VoiceRecord))
    library.espeak_ListVoices.argtypes = [ctypes.c_void_p]
    library.espeak_Synth.argtypes = [
        ctypes.c_char_p,
        ctypes.c_size_t,
        ctypes.c_uint,
        ctypes.c_int,
        ctypes.c_uint,
        ctypes.c_uint,
        ctypes.c_void_p,
        ctypes.c_void_p,
    ]
    return library, espeakng_loader.get_data_path().encode()


def _list_voices(library: Any) -> dict[str, tuple[int, bytes]]:
    """Return the priority (low is good) and the identifier of the best voice by language."""
    voices = library.espeak_ListVoices(None)
    best: dict[str, tuple[int, bytes]] = {}
    index = 0
    while voices[index]:
        record = voices[index].contents
        address = record.languages
        while (priority := ctypes.string_at(address, 1)[0]) != 0:
            tag = ctypes.string_at(address + 1)
            name = tag.decode("utf-8", "replace")
            if name not in best or priority < best[name][0]:
                best[name] = priority, record.identifier
            address += len(tag) + 2
        index += 1
    return best


def _choose_voices(name: str, known: dict[str, tuple[int, bytes]]) -> list[bytes]:
    """Return what espeak-ng may call the voice of a name or a tag, the most exact first."""
    plain = {tag.casefold(): identifier for tag, (_, identifier) in known.items()}
    parts = name.strip().replace("_", "-").casefold().split("-")
    tags = ["-".join(parts[:count]) for count in range(len(parts), 0, -1)]
    return [name.encode("utf-8", "replace")] + [plain[tag] for tag in tags if tag in plain]


def main() -> None:
    """Read the request from the input and write the answer."""
    request = json.loads(sys.stdin.buffer.read())
    library, folder = _load_library()
    samples: list[bytes] = []
    spoken = 0
    events: list[list[Any]] = []

    def receive(sound: Any, count: int, new: Any) -> int:
        nonlocal spoken
        if sound and count > 0:
            samples.append(ctypes.string_at(sound, 2 * count))
            spoken += count
        index = 0
        while (event := new[index]).type != 0:
            if event.type == _WORD:
                events.append(["word", event.sample, event.text_position, event.length, ""])
            elif event.type == _PHONE:
                name = _read_identifier(event).decode("utf-8", "ignore")
                events.append(["phone", event.sample, 0, 0, name])
            index += 1
        # 1 ends the speech.
        return int(spoken >= _LONGEST * rate)

    callback = _Callback(receive)
    rate = library.espeak_Initialize(_RETRIEVAL, 0, folder, _PHONE_EVENTS | _IPA)
    library.espeak_SetSynthCallback(callback)
    answer: dict[str, Any]
    voices = _list_voices(library)
    names = _choose_voices(request["voice"], voices)
    if all(library.espeak_SetVoiceByName(name) != 0 for name in names):
        answer = {"error": "voice", "voices": sorted(voices)}
    else:
        library.espeak_SetParameter(_SPEED, int(request["speed"]), 0)
        text = request["text"].encode()
        library.espeak_Synth(text, len(text) + 1, 0, 1, 0, _UTF8, None, None)
        library.espeak_Synchronize()
        is_cut = spoken >= _LONGEST * rate
        answer = {"rate": rate, "samples": spoken, "events": events, "is_cut": is_cut}
    sys.stdout.buffer.write(json.dumps(answer).encode() + b"\n" + b"".join(samples))


if __name__ == "__main__":
    main()
