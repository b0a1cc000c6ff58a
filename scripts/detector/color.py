# SPDX-License-Identifier: Apache-2.0
"""Video of high dynamic range (PQ, HLG) as sRGB."""

import numpy as np

PQ, HLG = 16, 18  # numbers of ITU-T H.273
REFERENCE_WHITE = 203.0  # candela per square metre, ITU-R BT.2408: a white sheet of paper; it becomes white of sRGB
BT709_FROM_BT2020 = np.array(
    [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]], np.float32
)


def srgb_from_hdr(rgb16, transfer):
    """[h, w, 3] of 16 bits, BT.2020 primaries -> 8-bit sRGB. Only what is brighter than paper is compressed."""
    signal = np.arange(65536, dtype=np.float64) / 65535
    if transfer == PQ:  # SMPTE ST 2084
        m1, m2, c1, c2, c3 = 2610 / 16384, 2523 / 4096 * 128, 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32
        e = signal ** (1 / m2)
        light = (10000 * (np.maximum(e - c1, 0) / (c2 - c3 * e)) ** (1 / m1) / REFERENCE_WHITE).astype(np.float32)[
            rgb16
        ]
    else:  # ITU-R BT.2100: scene light, then the system gamma of a display of 1,000 candela per square metre
        a, b, c = 0.17883277, 0.28466892, 0.55991073
        scene = np.where(signal <= 0.5, signal**2 / 3, (np.exp((signal - c) / a) + b) / 12).astype(np.float32)[
            rgb16
        ]
        luminance = scene @ np.array([0.2627, 0.6780, 0.0593], np.float32)
        light = scene * (1000 / REFERENCE_WHITE * np.maximum(luminance, 1e-6) ** 0.2)[..., None]
    light = light @ BT709_FROM_BT2020.T
    # Up to the knee, light is kept; above, it approaches 1, by the brightest channel, so that the hue stays.
    knee = 0.8
    peak = np.maximum(light.max(-1, keepdims=True), 1e-6)
    over = np.maximum(peak - knee, 0) / (1 - knee)
    light *= np.where(peak > knee, (knee + (1 - knee) * over / (1 + over)) / peak, 1)
    steps = np.clip(np.rint(light * 4095), 0, 4095).astype(np.uint16)
    linear = np.arange(4096) / 4095
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.rint(255 * srgb).astype(np.uint8)[steps]
