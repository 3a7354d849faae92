"""The catalogue of A-mode probes: an entry each; settings, models, page and REST read it.

How to add one: ``docs/how-to/add_a_probe.md``.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ProbeData:
    """What a laboratory knows of a probe: a disc transducer behind a delay line."""

    title: str
    centre_mhz: float
    aperture_radius_mm: float
    min_thickness_mm: float  # of bone that it resolves: the two echoes of thinner bone merge
    max_thickness_mm: float  # of bone that is looked for
    fades_mm: float  # thickness of bone beyond which a lower frequency detects more
    clutter: float  # what bone shows besides, over a nominal inner echo
    # Where equalising stops, over the peak of the power spectrum: loss in bone leaves a high
    # frequency short of signal, the length of its echo leaves a low one short of resolution.
    equal_floor: float
    bandwidth: float = 0.46  # full width at -6 dB over the centre frequency
    line_length_mm: float = 15.0


PROBE_DATA: dict[str, ProbeData] = {
    "2.25MHz": ProbeData(
        title="2.25 MHz",
        centre_mhz=2.25,
        aperture_radius_mm=3.175,
        min_thickness_mm=2.0,
        max_thickness_mm=12.0,
        fades_mm=8.0,
        clutter=0.1,
        equal_floor=1e-2,
    ),
    "1MHz": ProbeData(
        title="1 MHz",
        centre_mhz=1.0,
        aperture_radius_mm=6.35,
        min_thickness_mm=4.0,
        max_thickness_mm=14.0,
        fades_mm=14.0,
        clutter=0.2,
        equal_floor=2e-4,
    ),
}
# the highest first
BY_FREQUENCY = tuple(sorted(PROBE_DATA, key=lambda name: -PROBE_DATA[name].centre_mhz))
