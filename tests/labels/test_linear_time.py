"""Eight times the text takes eight times the time, in every format and whatever it holds."""

import contextlib
import time
import warnings

import pytest

from mocap_fit.errors import MocapFitError, MocapFitWarning
from mocap_fit.labels import csv, elan, esps, htk, mlf, seconds, textgrid, timit

GRID = (
    'File type = "ooTextFile"\nObject class = "TextGrid"\n0 1 <exists> 1 "IntervalTier" "p" 0 1 1\n'
)


def blanks(count):
    return " " * count


HOSTILE = {
    "timit blanks": (timit, lambda n: f"0 1 a{blanks(n)}b\n"),
    "timit gap": (timit, lambda n: f"0{blanks(n)}1{blanks(n)}a{blanks(n)}\n"),
    "htk digits": (htk, lambda n: f"0 1000000 {'1' * n}x {'2' * n}y\n"),
    "htk quotes": (htk, lambda n: "0 1000000 " + '"\\" ' * n + "\n"),
    "htk contexts": (htk, lambda n: f"0 1000000 {'a-' * n}{'a+' * n}\n"),
    "htk full contexts": (htk, lambda n: f"0 1000000 {'a^-+=' * n}[\n"),
    "htk states": (htk, lambda n: f"0 1000000 {'[1' * n}\n"),
    "htk levels": (htk, lambda n: "0 1 a\n" * (n // 24) + f"0 1{' b' * n}\n"),
    "mlf names": (mlf, lambda n: "#!MLF!#\n" + '"' * n + "\n"),
    "esps digits": (esps, lambda n: f"#\n0.5 {'1' * n}x\n"),
    "seconds digits": (seconds, lambda n: f"{'1' * n}x 1\n"),
    "seconds numbers": (seconds, lambda n: f"0.1 0.2{' 1.5' * n} x\n"),
    "textgrid digits": (textgrid, lambda n: f"{GRID}0 {'1' * n}x\n"),
    "textgrid quotes": (textgrid, lambda n: f'{GRID}0 1 "{"a""" * n}\n'),
    "textgrid signs": (textgrid, lambda n: GRID + "= [ ! \n" * n),
    "textgrid brackets": (textgrid, lambda n: GRID + "[" * n),
    "textgrid words": (textgrid, lambda n: GRID + "a " * n),
    "csv columns": (csv, lambda n: f"start,end{',a' * (n // 8)}\n0,1{',b' * (n // 8)}\n"),
    "elan parts": (
        elan,
        lambda n: (
            '<ANNOTATION_DOCUMENT><TIME_SLOT TIME_SLOT_ID="t" TIME_VALUE="0"/><TIER TIER_ID="a">'
            '<ALIGNABLE_ANNOTATION ANNOTATION_ID="a0" TIME_SLOT_REF1="t" TIME_SLOT_REF2="t"/>'
            + "".join(
                f'</TIER><TIER TIER_ID="a"><REF_ANNOTATION ANNOTATION_ID="a{i + 1}" '
                f'ANNOTATION_REF="a{i}" PREVIOUS_ANNOTATION="a{i}"/>'
                for i in range(n // 24)
            )
            + "</TIER></ANNOTATION_DOCUMENT>"
        ),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_the_time_is_proportional_to_the_text(name, tmp_path):
    reader, create = HOSTILE[name]

    def measure(count):
        path = tmp_path / f"{count}.lab"
        path.write_text(create(count))
        best = float("inf")
        for _ in range(3):
            begin = time.process_time()
            with contextlib.suppress(MocapFitError):
                reader.sniff(path)
                reader.read(path)
            best = min(best, time.process_time() - begin)
        return best

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MocapFitWarning)
        # A quadratic one takes 64 times as long; below a few milliseconds nothing is measured.
        assert measure(24000) < 20 * measure(3000) + 0.02
