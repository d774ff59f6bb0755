"""The table of all voices of espeak-ng: what each is given to say, its phones, what happens.

    python benchmarks/voices.py [--voices sv,de] [--jobs 2] [--out FILE]

Every voice says digits, and a sentence of its language where one is given below. Its phones go
through the rule-based model to the lips of the built-in head, at 60 frames a second: the last
column says how many bilabials there are and how many of them close, or why there is none. No movie
is drawn. The table is Markdown.
"""

import argparse
import warnings
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from mocap_fit.control.rule_based import RuleBased
from mocap_fit.errors import MocapFitError
from mocap_fit.evaluation.closure import CLOSED, measure_gaps
from mocap_fit.face import load_face
from mocap_fit.synthesis import speak_text, synthesise
from mocap_fit.synthesis.espeak_voices import LANGUAGES
from mocap_fit.synthesis.text_to_phones import list_voices

DIGITS = "1 2 3 4 5 6 7 8 9 10 11 12 20 100 1999"
SENTENCES = {
    "af": "My ma bak more brood vir die pappa.",
    "ar": "أبي يشرب القهوة في المطبخ كل صباح.",
    "bg": "Майка ми купи хляб и мляко от магазина.",
    "ca": "La mare compra pa i pomes al mercat.",
    "cmn": "我妈妈明天跑步去公园。",
    "cs": "Máma peče bábovku a vlk spí pod bukem.",
    "da": "Min bror køber brød og mælk på pladsen.",
    "de": "Mein Bruder backt am Montag einen Apfelkuchen.",
    "el": "Η μαμά μου πίνει καφέ με τον μπαμπά.",
    "en": "My mother bought a big purple lamp on Friday.",
    "es": "Mi mamá compra pan y pimientos en el barrio.",
    "et": "Ema küpsetab pühapäeval õunakooki.",
    "fa": "مادرم هر روز از بازار نان می‌خرد.",
    "fi": "Äiti leipoo pullaa ja pappa keittää kahvia.",
    "fr": "Maman prépare une soupe avec du beurre et du pain.",
    "he": "אמא שלי קונה לחם וחלב בבוקר.",
    "hi": "मेरी माँ बाज़ार से फल और सब्ज़ी लाती है।",
    "hu": "Apám minden reggel friss kenyeret és vajat vesz.",
    "id": "Ibu membeli pisang dan mangga di pasar.",
    "it": "La mamma prepara la pasta per il bambino.",
    "ja": "ママは パンと バナナを たべます。",
    "ko": "엄마는 아침마다 빵과 밥을 먹어요.",
    "lt": "Mama perka duoną, pieną ir obuolius.",
    "lv": "Mamma pērk maizi, pienu un ābolus.",
    "nb": "Pappa baker brød mens mamma plukker bær.",
    "nl": "Mijn broer bakt pannenkoeken met appel en boter.",
    "pl": "Mama piecze babkę, a pies śpi pod płotem.",
    "pt": "A minha mãe compra pão e bananas no bairro.",
    "ro": "Mama cumpără pâine și mere pentru bunica.",
    "ru": "Мама купила молоко, хлеб и большой пирог.",
    "sk": "Mama pečie bábovku a vlk spí pod bukom.",
    "sv": "Mamma och pappa bakar bullar på fredag.",
    "sw": "Mama anapika wali na samaki jikoni.",
    "ta": "அம்மா பால் மற்றும் பழம் வாங்கினார்.",
    "tr": "Annem pazardan ekmek, peynir ve biber alıyor.",
    "uk": "Моя мама пече пиріг, а тато п'є каву.",
    "vi": "Mẹ tôi mua bánh mì và cá ở chợ.",
}


def say(voice: str, text: str) -> tuple[str, str]:
    """Return the phones of a text in a voice, and what happened."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            phones = speak_text(text, voice).phones
        except MocapFitError as error:
            return "", f"{type(error).__name__}: {error.problem}"
        model, face = RuleBased().prepare(phones.phone_set), load_face()
        tracks = synthesise(phones, model, 60.0, face=face)
        lips = measure_gaps(face, tracks.values, tracks.times, phones, model.phone_set_)
    closed = sum(event.gap <= CLOSED for event in lips.bilabials)
    happened = f"{closed} of {len(lips.bilabials)} bilabials close"
    return " ".join(phones.phones), "; ".join([happened, *(str(w.message) for w in caught)])


def main() -> None:
    """Let every voice speak, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--voices", help="names with commas between; by default all")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    voices = options.voices.split(",") if options.voices else sorted({*list_voices(), *LANGUAGES})
    said = [(v, t) for v in voices for t in (DIGITS, SENTENCES.get(v.split("-")[0])) if t]
    with ProcessPoolExecutor(options.jobs) as pool:
        results = list(pool.map(say, *zip(*said, strict=True)))
    rows = ["| voice | text | phones | what happened |", "|---|---|---|---|"]
    rows += [
        "| " + " | ".join(cell.replace("|", "\\|") for cell in (*what, *result)) + " |"
        for what, result in zip(said, results, strict=True)
    ]
    speaking = {voice for (voice, _), (phones, _) in zip(said, results, strict=True) if phones}
    always = speaking - {v for (v, _), (phones, _) in zip(said, results, strict=True) if not phones}
    table = "\n".join(
        [
            *rows,
            "",
            f"{len(voices)} voices; {len(speaking)} speak, {len(always)} all they are given.",
        ]
    )
    if options.out is None:
        print(table)
    else:
        options.out.write_text(table + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
