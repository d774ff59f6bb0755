"""Phone sets as tables that JSON can hold: a trained model keeps the set it was trained on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mocap_fit.errors import FileFormatError
from mocap_fit.phones.phone_set import Phone, PhoneSet, StressMarks


def phone_set_table(phone_set: PhoneSet) -> dict[str, Any]:
    """All that a phone set says, as values that JSON can hold."""
    return {
        "name": phone_set.name,
        "language": phone_set.language,
        "description": phone_set.description,
        "ignore_case": phone_set.ignore_case,
        "computed": phone_set.compute is not None,
        "stress": {
            "levels": list(phone_set.stress.levels),
            "marks": {str(level): list(marks) for level, marks in phone_set.stress.marks.items()},
            "position": phone_set.stress.position,
        },
        "phones": [_row(phone) for phone in phone_set.phones],
    }


def phone_set_from_table(table: Mapping[str, Any]) -> PhoneSet:
    """The phone set that `phone_set_table` described.

    Raises
    ------
    FileFormatError
        If the table is not one of these.
    """
    compute = None
    try:
        if table["computed"]:
            from mocap_fit.phones.computed import computed_phone

            compute = computed_phone
        stress = table["stress"]
        marks = {int(level): tuple(marks) for level, marks in stress["marks"].items()}
        return PhoneSet(
            table["name"],
            tuple(_phone(row) for row in table["phones"]),
            language=table["language"],
            description=table["description"],
            stress=StressMarks(tuple(stress["levels"]), marks, stress["position"]),
            ignore_case=table["ignore_case"],
            compute=compute,
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise FileFormatError(
            "the phone set in this file is damaged", found=f"{type(error).__name__}: {error}"
        ) from None


def _row(phone: Phone) -> dict[str, Any]:
    return {
        "symbol": phone.symbol,
        "kind": phone.kind,
        "values": {name: value for name, value in phone.values.items() if value},
        "ipa": list(phone.ipa),
        "also": list(phone.also),
        "takes_stress": phone.takes_stress,
        "resists": sorted(phone.resists or ()),
        "example": phone.example,
    }


def _phone(row: Mapping[str, Any]) -> Phone:
    return Phone(
        row["symbol"],
        row["kind"],
        row["values"],
        ipa=tuple(row["ipa"]),
        also=tuple(row["also"]),
        takes_stress=row["takes_stress"],
        resists=frozenset(row["resists"]),
        example=row["example"],
    )
