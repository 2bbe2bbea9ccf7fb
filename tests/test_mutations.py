"""Bad input: a random mutation of a case file is refused with a CaseError, or is a case that builds."""

import warnings

import pytest
from mutations import mutations

import jaxsph as js
from jaxsph.case.case import Case
from jaxsph.case.geometry import Geometry
from jaxsph.case.limits import particle_counts

SEED = 16
FEW = 400
MANY = 4000
BUILT = 60


def outcome(mutation, folder):
    """(case, None) for a valid mutation, (None, message) for a refused one; any other error is raised."""
    try:
        if isinstance(mutation, bytes):
            path = folder / "mutated.toml"
            path.write_bytes(mutation)
            case = js.load_case(path)
        else:
            case = Case.from_dict(mutation)
        case.notices()
        assert Case.from_dict(case.model_dump(exclude_none=True, mode="json")) == case
        return case, None
    except js.CaseError as error:
        return None, str(error)


def tried(count, folder):
    """Valid cases among `count` mutations; fails if a mutation raises anything but a CaseError."""
    cases, wrong = [], []
    for number, mutation in mutations(SEED, count):
        try:
            case, words = outcome(mutation, folder)
        except Exception as error:
            wrong.append((number, type(error).__name__, str(error)[:100]))
            continue
        if case is not None:
            cases.append((number, case))
        elif not words or len(words) > 4000:
            wrong.append((number, "words", words[:100]))
    assert not wrong, f"{len(wrong)} of {count} mutations: {wrong[:10]}"
    return cases


def test_mutations_are_refused_in_words_or_valid(tmp_path):
    cases = tried(FEW, tmp_path)
    # with fewer valid ones, combinations of sections would hardly be tested
    assert 0.1 * FEW < len(cases) < 0.9 * FEW


@pytest.mark.slow
def test_mutations_that_are_valid_build(tmp_path):
    """Only cases of up to 3000 particles; larger cases differ only in their computing time."""
    wrong, built = [], 0
    for number, case in tried(MANY, tmp_path):
        if built == BUILT:
            break
        if sum(particle_counts(case, Geometry.of(case))) > 3000 or case.precision == "float64":
            continue
        built += 1
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", RuntimeWarning)
                model, state = js.build(case)
            count = state.particles.x.shape[0]
            assert 0 < float(model.dt) <= case.output.sample_dt and count > 0
            expected, walls = particle_counts(case, Geometry.of(case))
            assert 0.7 * count < expected < 1.8 * count + 100, (expected, count)
            assert 0.7 * model.walls.count < walls < 1.5 * model.walls.count + 100, (walls, model.walls.count)
        except js.CaseError:
            continue
        except Exception as error:
            wrong.append((number, type(error).__name__, str(error)[:100]))
    assert not wrong, f"{len(wrong)} of {built} built: {wrong}"
    assert built == BUILT
