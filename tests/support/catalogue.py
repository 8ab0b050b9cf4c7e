"""How every effect shows itself, as a build's manifest has it, without a build."""

from __future__ import annotations

import json

from gen.builder.effect_description import describe_catalogue
from hdagen.arm.effect_catalogue import EffectCatalogue

EFFECTS = EffectCatalogue(json.loads(json.dumps(describe_catalogue(in_space=False))))
