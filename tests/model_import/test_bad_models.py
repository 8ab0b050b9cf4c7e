"""Models that cannot be imported: one sentence for each thing wrong, quickly, with element and cure."""

from __future__ import annotations

from pathlib import Path

import pytest
from mutants import fate, kinds, mutant
from sample_models import chain, link, urdf, write

from hdagen.model_import.model_file import ModelError
from hdagen.model_import.robot_writing import import_model

TIE = '<joint name="c" type="fixed"><parent link="{}"/><child link="{}"/></joint>'


def make_tie(k: int) -> str:
    """A fixed joint of the links k and k + 1."""
    return TIE.format(k, k + 1).replace('"c"', f'"c{k}"')


BAD: dict[str, tuple[str, str, str]] = {
    "no file": ("", "missing.urdf", "missing.urdf: "),
    "no XML": ("not xml", "a.xml", "found text that is no XML"),
    "other XML": ("<html/>", "a.xml", "found the element 'html' at the top, possible are <robot> and <mujoco>"),
    "entity bomb": ('<!DOCTYPE r [<!ENTITY a "aaaa">]><robot>&a;</robot>', "a.urdf", "found a DOCTYPE or ENTITY"),
    "xacro": (
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:a/></robot>',
        "a.urdf",
        "a.urdf > model.urdf`",
    ),
    "xacro file": ("<robot/>", "a.xacro", "expand it by `xacro"),
    "include outside": ('<mujoco><include file="../x.xml"/></mujoco>', "in/a.xml", "possible is a file in the model's"),
    "include loop": ('<mujoco><include file="a.xml"/></mujoco>', "a.xml", "names 'a.xml' again"),
    "include missing": ('<mujoco><include file="b.xml"/></mujoco>', "a.xml", "b.xml: "),
    "0 joints": ('<mujoco><worldbody><body name="b"/></worldbody></mujoco>', "a.xml", "found 0 joints between"),
    "13 joints": (chain(13), "a.xml", "found 13 joints between base and tip, possible are 1 to 12"),
    "negative inertia": (urdf(ixx="-0.02"), "a.urdf", "joint a: found the principal moments -0.02, 0.02, 0.02 kg m²"),
    "triangle": (urdf(ixx="0.05"), "a.urdf", "joint a: found the principal moments 0.02, 0.02, 0.05 kg m² of one,"),
    "negative inertia in MJCF": (
        chain(1).replace('"1 1 1"', '"-1 1 1"'),
        "a.xml",
        "body b0: found the principal moments -1, 1, 1 kg m², possible are numbers from 0",
    ),
    "triangle in MJCF": (chain(1).replace('"1 1 1"', '"1 1 5"'), "a.xml", "the principal moments 1, 1, 5 kg m²"),
    "equal limits": (
        urdf().replace('lower="-1" upper="1"', 'lower="1" upper="1"'),
        "a.urdf",
        "joint a of one has the limits 1 to 1, between which it cannot move, possible is the lower limit below the",
    ),
    "equal limits of zero": (
        urdf().replace('lower="-1" upper="1"', 'lower="0" upper="0"'),
        "a.urdf",
        "state them, or weld it by --at a=0",
    ),
    "equal limits in MJCF": (
        chain(1).replace("<joint ", '<joint range="90 90" '),
        "a.xml",
        "weld it by --at j_b0=1.5707963",
    ),
    "range of zero in MJCF": (
        chain(1).replace("<joint ", '<joint limited="true" '),
        "a.xml",
        "j_b0 of b0 has the limits 0 to 0",
    ),
    "range upside down in MJCF": (
        chain(1).replace("<joint ", '<joint range="2 1" '),
        "a.xml",
        "a.xml, joint 'j_b0': found the range 2 to 1, possible is the lower end before the upper; correct range.",
    ),
    "range upside down in a class": (
        chain(1).replace("<world", '<default><joint range="2 1"/></default><world'),
        "a.xml",
        "joint 'j_b0': found the range 2 to 1",
    ),
    "torque limits upside down": (
        chain(1).replace("<joint ", '<joint actuatorfrcrange="2 1" '),
        "a.xml",
        "joint 'j_b0': found the actuatorfrcrange 2 to 1",
    ),
    "force of one size": (
        chain(1).replace("</mujoco>", '<actuator><motor joint="j_b0" forcerange="3 3"/></actuator></mujoco>'),
        "a.xml",
        "actuator 'j_b0': found the forcerange 3 to 3",
    ),
    "20 000 nested bodies": (
        f"<mujoco><worldbody>{'<body>' * 20_000}{'</body>' * 20_000}</worldbody></mujoco>",
        "a.xml",
        "found elements 20002 deep in one another, possible are 200; join the bodies",
    ),
    "20 000 links in a row": (
        f'<robot name="a">{"".join(f"""<link name="{k}"/>""" for k in range(20_000))}'
        f"{''.join(make_tie(k) for k in range(19_999))}</robot>",
        "a.urdf",
        "found 79998 elements",
    ),
    "300 links in a row": (
        f'<robot name="a">{"".join(f"""<link name="{k}"/>""" for k in range(301))}'
        f"{''.join(make_tie(k) for k in range(300))}</robot>",
        "a.urdf",
        "<link> '300': found 300 links that hang on one another, possible are 200",
    ),
    "20 000 bodies in a row": (
        f"<mujoco><worldbody>{'<body/>' * 20_000}</worldbody></mujoco>",
        "a.xml",
        "found 20002 elements",
    ),
    "massless": (urdf(mass="0", ixx="0"), "a.urdf", "link one behind joint a: found no mass, possible is above 0"),
    "axis of length 0": (chain(1).replace("<joint ", '<joint axis="0 0 0" '), "a.xml", "MuJoCo refuses it"),
    "quaternion 0": (chain(1).replace('name="b0"', 'name="b0" quat="0 0 0 0"'), "a.xml", "MuJoCo "),
    "NaN": (chain(1).replace('mass="1.0"', 'mass="nan"'), "a.xml", "<inertial>: found NaN in mass, possible are"),
    "duplicate joints": (chain(2).replace("j_b1", "j_b0"), "a.xml", "MuJoCo"),
    "two parents": (urdf(more=TIE.format("two", "one")), "a.urdf", "<joint> 'c': 'one' is another joint's child, too;"),
    "cyclic": (urdf(more=TIE.format("two", "root")), "a.urdf", "every link is another one's child, possible is a tree"),
    "cyclic beside": (
        urdf(
            more='<link name="x"/><link name="y"/>' + TIE.format("x", "y") + TIE.format("y", "x").replace('"c"', '"d"')
        ),
        "a.urdf",
        "hangs on itself, possible is a tree; cut the loop",
    ),
    "two roots": (urdf(more='<link name="lonely"/>'), "a.urdf", "found the roots lonely, root, possible is one; join"),
    "duplicate links": (urdf(more='<link name="one"/>'), "a.urdf", "found 2 <link> with the name 'one'; give each its"),
    "joints of one name": (urdf().replace('name="b"', 'name="a"'), "a.urdf", "found 2 <joint> with the name 'a'"),
    "no such child": (
        urdf().replace('child link="one"', 'child link="no"'),
        "a.urdf",
        "found the child 'no', possible",
    ),
    "NaN in a frame": (urdf().replace('xyz="0.3 0 0"', 'xyz="0 nan 0"'), "a.urdf", "<origin>: found NaN in xyz"),
    "NaN of an axis": (chain(1).replace("<joint ", '<joint axis="0 0 -NaN" '), "a.xml", "'j_b0': found NaN in axis"),
    "NaN of gravity": (
        chain(1).replace("<world", '<option gravity="nan 0 0"/><world'),
        "a.xml",
        "found NaN in gravity",
    ),
    "infinite inertia": (
        chain(1).replace("1 1 1", "inf inf inf"),
        "a.xml",
        "body b0: found NaN, infinity or a number beyond 1e+12",
    ),
    "infinite inertia of a link": (
        urdf(ixx="inf"),
        "a.urdf",
        "body one: found NaN, infinity or a number beyond 1e+12",
    ),
    "infinite reference": (chain(1).replace("<joint ", '<joint ref="inf" '), "a.xml", "in <option> or ref"),
    "negative mass": (
        chain(1).replace('mass="1.0"', 'mass="-1"'),
        "a.xml",
        "body b0: found the mass -1 kg, possible are",
    ),
    "negative mass of a link": (urdf(mass="-1"), "a.urdf", "<link> 'one': found the mass -1 kg"),
    "negative damping": (urdf().replace("0.5", "-0.5"), "a.urdf", "<joint> 'a': found the damping -0.5, possible are"),
    "negative armature": (chain(1).replace("<joint ", '<joint armature="-3" '), "a.xml", "j_b0: found the armature -3"),
    "negative effort": (urdf().replace("20", "-20"), "a.urdf", "<joint> 'a': found the effort -20, possible are"),
    "range upside down": (urdf().replace('lower="-1"', 'lower="5"'), "a.urdf", "'a': found the range 5 to 1, possible"),
    "millimetres": (
        chain(2).replace('name="b1"', 'name="b1" pos="0 0 333"'),
        "a.xml",
        "the distance 333 m, possible are",
    ),
    "far too heavy": (
        chain(1).replace('mass="1.0"', 'mass="1e300"'),
        "a.xml",
        "body b0: found NaN, infinity or a number beyond",
    ),
    "too heavy": (chain(1).replace('mass="1.0"', 'mass="1e6"'), "a.xml", "the mass 1e+06 kg, possible are 10000 kg"),
    "no mass between": (
        chain(3).replace('mass="1.0"', 'mass="0"', 1),
        "a.xml",
        "link b0 behind joint j_b0: found no mass",
    ),
    "copies": (
        chain(1).replace("<body", '<replicate count="100000000"><geom/></replicate><body'),
        "a.xml",
        "found 2e+08 elements, with the copies",
    ),
    "copies of copies": (
        chain(1).replace("<body", '<replicate count="200"><replicate count="300"><geom/></replicate></replicate><body'),
        "a.xml",
        "found 120205 elements, with the copies that <replicate> and the like make, possible are 10000; leave out",
    ),
    "copies of a file": (
        chain(1).replace("<body", '<replicate count="2"><include file="b.xml"/></replicate><body'),
        "a.xml",
        "found inf elements",
    ),
    "ball": (chain(1).replace("<joint ", '<joint type="ball" '), "a.xml", "is ball, possible are revolute and prism"),
    "floating": (urdf(kind="floating"), "a.urdf", "<joint> 'a': found the type floating, possible is one below"),
    "two tips": (
        f"<mujoco><worldbody>{link('l')}</body>{link('r')}</body></worldbody></mujoco>",
        "a.xml",
        "found a tree with several tips, possible is one chain; name its end by --tip",
    ),
    "two tips behind a fixed link": (
        f'<mujoco><worldbody><body name="trunk">{link("l")}</body>{link("r")}</body></body></worldbody></mujoco>',
        "a.xml",
        "possible is one chain; name its end by --tip, of l, r",
    ),
    "mesh inertia": (
        '<mujoco><asset><mesh name="m" file="m.stl"/></asset><worldbody><body name="b"><joint/>'
        '<geom type="mesh" mesh="m"/></body></worldbody></mujoco>',
        "a.xml",
        "body b: found no inertia but that of a mesh",
    ),
    "mimic": (
        chain(2).replace("</mujoco>", '<equality><joint joint1="j_b0" joint2="j_b1"/></equality></mujoco>'),
        "a.xml",
        "is coupled to another joint, possible are independent joints; leave it out by --joints",
    ),
    "closed loop": (
        chain(2).replace("</mujoco>", '<equality><connect body1="b1" anchor="0 0 0"/></equality></mujoco>'),
        "a.xml",
        "b1 is tied to another body in a closed loop",
    ),
    "two joints": (chain(1).replace("<joint ", '<joint name="more"/><joint '), "a.xml", "b0 has several joints"),
    "no name": (chain(1).replace(' name="j_b0"', ""), "a.xml", "needs a name"),
}


@pytest.mark.parametrize("what", BAD)
def test_what_is_wrong_is_one_sentence(what: str, tmp_path: Path) -> None:
    text, name, words = BAD[what]
    path = tmp_path / name
    if text:
        write(tmp_path, text, name)
    with pytest.raises(ModelError) as refused:
        import_model(str(path))
    sentence = str(refused.value)
    assert words in sentence and "\n" not in sentence and sentence.isprintable() and len(sentence) < 700, sentence


def test_elements_of_included_files_are_counted(tmp_path: Path) -> None:
    bodies = "<body>" * 150 + "{}" + "</body>" * 150
    write(tmp_path, f"<mujoco>{bodies}</mujoco>".replace("{}", ""), "b.xml")
    inner = bodies.format('<include file="b.xml"/>')
    main = write(tmp_path, f"<mujoco><worldbody>{inner}</worldbody></mujoco>")
    with pytest.raises(ModelError, match="b.xml: <body>: found elements 303 deep in one another"):
        import_model(main)
    write(tmp_path, f"<mujoco>{'<body/>' * 6000}</mujoco>", "b.xml")
    main = write(tmp_path, f'<mujoco><worldbody>{"<body/>" * 6000}<include file="b.xml"/></worldbody></mujoco>')
    with pytest.raises(ModelError, match="b.xml: found 12004 elements"):
        import_model(main)


def test_a_urdf_is_not_included(tmp_path: Path) -> None:
    write(tmp_path, urdf(), "b.xml")
    with pytest.raises(ModelError, match="<include> names 'b.xml', which is a URDF, possible is MJCF"):
        import_model(write(tmp_path, '<mujoco><include file="b.xml"/></mujoco>'))


def test_damaged_models_are_read_or_refused_in_sentences(tmp_path: Path) -> None:
    made = [kind for kind in kinds(tmp_path) if kind.name.startswith("model.")]
    for kind in made:
        for seed in kind.seeds.values():
            assert fate(kind, seed, tmp_path) == "read"
        for number in range(150):
            assert fate(kind, mutant(kind, number), tmp_path) in ("read", "refused"), (kind.name, number)
