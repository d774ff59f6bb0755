"""The small recordings that are shipped with the package, for examples and first attempts."""

from __future__ import annotations

from pathlib import Path

from mocap_fit.errors import ConfigurationError

_FOLDER = Path(__file__).parent / "samples"
_FILES = {
    "rest": "rest.tsv",
    "take_01": "take_01.tsv",
    "take_01.TextGrid": "take_01.TextGrid",
    "take_01.wav": "take_01.wav",
}


def load_sample(name: str) -> Path:
    """Return the path of a sample recording that is shipped with the package.

    The samples are of one simulated speaker with the 35 markers of the layout ``face30-head5``,
    recorded at 60 Hz. The recording, its labels and its sound share one clock.

    Parameters
    ----------
    name
        One of

        - ``"rest"``: the reference pose, face and head at rest (Qualisys TSV, 0.5 seconds);
        - ``"take_01"``: a spoken Swedish sentence with head motion, noise and gaps (Qualisys TSV);
        - ``"take_01.TextGrid"``: its words and phones, in the phone set ``sv-sta``;
        - ``"take_01.wav"``: its sound, one channel at 8000 Hz.

    Returns
    -------
    Path
        An existing file.

    Raises
    ------
    ConfigurationError
        If there is no sample of that name.

    See Also
    --------
    read_tracks : Read the markers of a recording.
    read_phones : Read the phones of an utterance.

    Examples
    --------
    >>> import mocap_fit as mf
    >>> mf.load_sample("rest").name
    'rest.tsv'
    >>> rest = mf.read_tracks(mf.load_sample("rest"))
    >>> rest.frames, len(rest.names)
    (30, 35)
    """
    try:
        return _FOLDER / _FILES[name]
    except KeyError:
        raise ConfigurationError(
            "there is no sample recording of that name",
            found=f"'{name}'",
            expected=", ".join(_FILES),
            advice="Choose one of these names.",
        ) from None
