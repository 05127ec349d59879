"""Tire property files: what is read, and the sentence for everything that is not."""

import warnings

import pytest

from fmu_sources.tires.coefficients import COEFFICIENTS
from fmu_sources.tires.magic_formula import MagicFormula
from fmu_sources.tires.tir_file import TireError, TireWarning, read_tire
from fmu_sources.vehicles import VehicleError, load_vehicle, loader, vehicle_files

FOLDER = loader._HERE.parent / "tires"
SEDAN = (FOLDER / "sedan.tir").read_text()


def file(tmp_path, text, name="own.tir"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize(("name", "version"), [("hmmwv", 6), ("sedan", 5), ("truck", 5)])
def test_own_files(name, version):
    tire = read_tire(FOLDER / f"{name}.tir")
    assert (tire.version, tire.side) == (version, 1)
    assert set(tire.values) == set(COEFFICIENTS)


def test_as_vendors_write_them(tmp_path):
    """Comments of either kind and any encoding, quotes, lower case, tables without names, other sections."""
    text = SEDAN.replace("PCX1 = 1.65", "pcx1   =  1.65E+00   $ shape factor")
    text = text.replace("TYRESIDE = 'LEFT'", "TYRESIDE = 'Right'  ! side")
    text += "[SHAPE]\n{radial width}\n 1.0 0.0\n[TURNSLIP_COEFFICIENTS]\nPDXP1 = 0.4\n[CONTACT_PATCH]\nQRA1 = 0.7\n"
    tire = read_tire(file(tmp_path, text.encode() + "! Größe\r\n".encode("latin-1")))
    assert tire.values["PCX1"] == 1.65
    assert tire.side == -1


@pytest.mark.parametrize(("fit", "version"), [("5", 5), ("6", 5), ("21", 5), ("51.0", 5), ("60", 6), ("61", 6)])
def test_versions(tmp_path, fit, version):
    text = SEDAN.replace("FITTYP   = 52", f"FITTYP = {fit}")
    if version == 6:
        text = "\n".join(
            line for line in text.splitlines() if line.split(" ")[0] not in ("PHY3", "QBZ4", "LGAX", "LGAY", "LGAZ")
        )
    assert read_tire(file(tmp_path, text)).version == version


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-be"])
def test_encodings(tmp_path, encoding):
    text = "\ufeff" + SEDAN if encoding == "utf-16-be" else SEDAN
    assert read_tire(file(tmp_path, text.encode(encoding))) == read_tire(file(tmp_path, SEDAN))


def test_pressure_that_is_not_given_has_no_influence(tmp_path):
    only = read_tire(file(tmp_path, SEDAN + "[OPERATING_CONDITIONS]\nINFLPRES = 230000\n"))
    assert only.values["NOMPRES"] == 230000


@pytest.mark.parametrize(("change", "sentence"), [
    (("PCX1 = 1.65", ""), "own.tir: PCX1 missing; a Magic Formula tire needs them"),
    (("PCX1 = 1.65", "PCX1 = 1.6.5"), "own.tir:42: PCX1 = 1.6.5: must be a finite number"),
    (("PCX1 = 1.65", "PCX1 = nan"), "own.tir:42: PCX1 = nan: must be a finite number"),
    (("PCX1 = 1.65", "PCX1 ="), "own.tir: PCX1 missing; a Magic Formula tire needs them"),
    (("PCX1 = 1.65", "PCX1 = 1\nPCX1 = 2"), "own.tir:43: PCX1 is given a second time, after line 42; remove one"),
    (("PDX1 = 1.12", "PDX1 = -1"), "own.tir: PDX1 = -1: must be above 0"),
    (("PKY1 = -19.0", "PKY1 = 19"), "own.tir: PKY1 = 19, PDY1 = 1: PKY1 must be below 0"),
    (("'meter'", "'mm'"), "own.tir:7: LENGTH = 'mm': only SI units are read; export the file with meter"),
    (("FITTYP   = 52", "FITTYP = 63"), "own.tir:13: FITTYP = 63: Magic Formula 5.2"),
    (("FITTYP   = 52", "FITTYP = 'PAC2002'"), "own.tir:13: FITTYP = 'PAC2002': Magic Formula 5.2"),
    (("PDX1 = 1.12", "PDX1 = 1e11"), "own.tir: PDX1 = 1e+11: its size must be 0 to 10; SI units are needed"),
    (("PEX1 = ", "PEX1 = 1e300 $ "), "own.tir: PEX1 = 1e+300: its size must be 0 to 1e+06; SI units are needed"),
    (("UNLOADED_RADIUS = 0.3", "UNLOADED_RADIUS = 300.3"), "m: its size must be 0.05 to 5; SI units are needed"),
    (("PDX2 =", "PDX2"), "write it as NAME = VALUE"),
    (("LKY = 1", "LKY = 0"), "own.tir: LKY = 0: must be above 0"),
    (("FITTYP   = 52", "PROPERTY_FILE_FORMAT = 'FIALA'"), "own.tir:13: PROPERTY_FILE_FORMAT = 'FIALA': Magic"),
    (("FITTYP   = 52", ""), "own.tir: neither FITTYP nor PROPERTY_FILE_FORMAT in [MODEL]: Magic"),
    (("PKX3 = 0.2", "PKX3 = 200"), "own.tir: PKX3 = 200: an exponent of at most 20 is needed"),
    (("TYRESIDE = 'LEFT'", "TYRESIDE = 'TOP'"), "own.tir:14: TYRESIDE = 'TOP': must be 'LEFT' or 'RIGHT'"),
    (("KPUMIN = -1.0", "KPUMIN = 0.1"), "own.tir: KPUMIN = 0.1, KPUMAX = 1: 0 must lie between them"),
    (("FZMAX = 12000", "FZMAX = 100"), "own.tir: FZMIN = 150 must be at least 0 and below FZMAX"),
])  # fmt: skip
def test_mistakes_have_a_sentence(tmp_path, change, sentence):
    assert change[0] in SEDAN
    with pytest.raises(TireError) as error:
        read_tire(file(tmp_path, SEDAN.replace(*change, 1)))
    assert sentence in str(error.value)


@pytest.mark.parametrize(("change", "sentence"), [
    (("PDX2", "PDXX2"), "own.tir:44: PDXX2 has no influence: no coefficient of [LONGITUDINAL_COEFFICIENTS] is"),
    (("FITTYP   = 52", "FITTYP = 61"), "PHY3 belongs to Magic Formula 5.2 and has no influence; see FITTYP"),
    (("FITTYP   = 52", "FITTYP = 62"), "own.tir:13: FITTYP = 62: read as 6.1"),
    (("FITTYP   = 52", "FITTYP = 52\nUSE_MODE = -12"), "own.tir:14: USE_MODE = -12 has no influence: all forces"),
    (("PDX2 = ", "PDX2 = -3 $ "), "own.tir: PDX1 + PDX2 dfz = -4.88 at the load 12000 N: forces there have the wrong"),
    (("PCX1 = 1.65", "PCX1 = 1.65\nPKY5 = 1"), "own.tir:43: PKY5 has no influence: no coefficient of [LONGITUDINAL"),
])  # fmt: skip
def test_what_has_no_influence_is_warned_of(tmp_path, change, sentence):
    assert change[0] in SEDAN
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        read_tire(file(tmp_path, SEDAN.replace(*change, 1)))
    assert any(sentence in str(w.message) and w.category is TireWarning for w in found)


@pytest.mark.filterwarnings("error")
def test_what_vendors_files_contain(tmp_path):
    """Values left open, names of PAC2002, other parts of the model, ranges of one direction or 90 degrees."""
    text = SEDAN.replace("KPUMIN = -1.0\nKPUMAX = 1.0", "KPUMIN = -0.8\nKPUMAX = 0.0")
    text = text.replace("ALPMIN = -0.7\nALPMAX = 0.7", "ALPMIN = -1.5708\nALPMAX = 1.5708")
    text = text.replace("CAMMIN = -0.2", "CAMMIN =").replace("PDX3 = 0.6", "PDX3 =   $ not measured")
    text = text.replace(
        "[LONGITUDINAL_COEFFICIENTS]", "LGYR = 1\nLCZ = 0.4\nLIP = 1\n[LONGITUDINAL_COEFFICIENTS]\nPTX4 = 0.1"
    )
    text = text.replace("FITTYP   = 52", "PROPERTY_FILE_FORMAT='PAC2002'  $Tire property type\nUSE_MODE = 14")
    text = text.replace("PDY1 = 1.0", "PDY1 = -1.0")  # the slope is that of PKY1 all the same
    text += "QTZ1 = 0.2\nMBELT = 4.9\n[TIRE_CONDITIONS]\nIP = 240000\nIP_NOM = 220000\n"
    tire = read_tire(file(tmp_path, text))
    v = tire.values
    assert (v["INFLPRES"], v["NOMPRES"], v["PDX3"]) == (240000, 220000, 0)
    assert (v["KPUMIN"], v["KPUMAX"], v["ALPMIN"], v["ALPMAX"], v["CAMMIN"]) == (-0.8, 0.8, -1.5, 1.5, -0.5)
    assert float(MagicFormula(tire).forces(4000.0, 0.0, 1e-3, 0.0, 20.0).fy) < 0


@pytest.mark.parametrize("text", [b"", b"hello", b"\x00\xff" * 100, b"[MODEL]\n" * 1000])
def test_what_is_no_tire_file(tmp_path, text):
    with pytest.raises(TireError, match="no tire property file"):
        read_tire(file(tmp_path, text))


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(TireError, match="cannot be read"):
        read_tire(tmp_path / "none.tir")
    with pytest.raises(TireError, match="more than 1000 kB"):
        read_tire(file(tmp_path, b" " * 2_000_000))


# ------------------------ in vehicle files


def vehicle(tmp_path, tire):
    return file(tmp_path, f'base = "hmmwv_modified"\n[tire]\nfile = {tire}\n', "own.toml")


def test_a_vehicle_names_a_file_beside_it(tmp_path):
    tire = file(tmp_path, SEDAN)
    path = vehicle(tmp_path, '"own.tir"')
    assert load_vehicle(path).tire.file == read_tire(tire)
    assert tire in vehicle_files(path)  # an FMU is built again when it changes
    heir = file(tmp_path, 'base = "own.toml"\n', "heir.toml")
    assert load_vehicle(heir).tire.file == read_tire(tire)


@pytest.mark.parametrize(("tire", "sentence"), [
    ('"none.tir"', "tire.file: .*none.tir: cannot be read"),
    ("5", "tire.file = 5 must be the path of a tire property file"),
])  # fmt: skip
def test_a_vehicle_that_names_no_tire_file(tmp_path, tire, sentence):
    with pytest.raises(VehicleError, match=sentence):
        load_vehicle(vehicle(tmp_path, tire))
