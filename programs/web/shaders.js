// SPDX-License-Identifier: Apache-2.0
// The programs of the client engine. Equations as in include/gsh/avatar/skinned_gaussian.hpp (posing, colour),
// include/gsh/render/projection.hpp and rasterizer.hpp (drawing), programs/view/ellipsoids.hpp (solids).
"use strict";

gsh.shaders = (() => {
  const head = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
`;

  /** Draws one triangle that covers the target. */
  const cover = head + `
void main() {
  gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
}`;

  /**
   * Poses one Gaussian per fragment and writes mean and opacity, a factor of the covariance, colour. settings:
   * {texels, wide, influences, degree, body, lit, deformation, clampAbove, occlusionBlocks}; wide: of the textures of
   * fixed numbers and of results.
   */
  function pose(settings) {
    const blocks = Math.ceil(settings.influences / 4), joints = 5, weights = joints + blocks, sh = weights + blocks;
    return head + `
#define TEXELS ${settings.texels}
#define WIDE ${settings.wide}
#define BLOCKS ${blocks}
#define DEGREE ${settings.degree}
#define BODY ${settings.body ? 1 : 0}
#define LIT ${settings.lit ? 1 : 0}
#define DUAL ${settings.deformation === "dual_quaternion" ? 1 : 0}
#define POLAR ${settings.deformation === "polar" ? 1 : 0}
#define CLAMP_ABOVE ${settings.clampAbove ? 1 : 0}
#define OCCLUSION_BLOCKS ${settings.occlusionBlocks}
uniform sampler2D u_fixed, u_bones, u_vertices;
uniform int u_count, u_first_row, u_vertices_wide;
uniform vec3 u_center;
uniform float u_occlusion; // 1: ambient occlusion is shown
#if OCCLUSION_BLOCKS
uniform sampler2D u_occlusion_basis;
uniform vec4 u_occlusion_shares[OCCLUSION_BLOCKS]; // of the basis in this pose
#endif
layout(location = 0) out vec4 o_mean;
layout(location = 1) out vec4 o_factor;
layout(location = 2) out vec4 o_rest;
layout(location = 3) out vec4 o_color;

int gaussian;
vec4 fixed_number(int k) {
  int at = gaussian * TEXELS + k;
  return texelFetch(u_fixed, ivec2(at % WIDE, at / WIDE), 0);
}
vec4 vertex(float index) {
  int at = int(index);
  return texelFetch(u_vertices, ivec2(at % u_vertices_wide, at / u_vertices_wide), 0);
}
vec3 sh(int k) { return fixed_number(${sh} + k).xyz; }

mat3 rotation(vec4 q) { // q = (w, x, y, z), of any length
  float s = 2.0 / dot(q, q), w = q.x, x = q.y, y = q.z, z = q.w;
  return mat3(1.0 - s * (y * y + z * z), s * (x * y + w * z), s * (x * z - w * y),
              s * (x * y - w * z), 1.0 - s * (x * x + z * z), s * (y * z + w * x),
              s * (x * z + w * y), s * (y * z - w * x), 1.0 - s * (x * x + y * y));
}

vec3 harmonics(vec3 d) {
  float x = d.x, y = d.y, z = d.z, xx = x * x, yy = y * y, zz = z * z;
  vec3 c = 0.28209479177387814 * sh(0);
#if DEGREE >= 1
  c += 0.48860251190291992 * (-y * sh(1) + z * sh(2) - x * sh(3));
#endif
#if DEGREE >= 2
  c += 1.09254843059207907 * (x * y * sh(4) - y * z * sh(5) - x * z * sh(7)) +
       0.31539156525252001 * (2.0 * zz - xx - yy) * sh(6) + 0.54627421529603954 * (xx - yy) * sh(8);
#endif
#if DEGREE >= 3
  float f = 4.0 * zz - xx - yy;
  c += 0.59004358992664352 * (-y * (3.0 * xx - yy) * sh(9) - x * (xx - 3.0 * yy) * sh(15)) +
       2.89061144264055405 * x * y * z * sh(10) + 0.45704579946446577 * (-y * f * sh(11) - x * f * sh(13)) +
       0.37317633259011540 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy) * sh(12) +
       1.44530572132027703 * z * (xx - yy) * sh(14);
#endif
#if DEGREE >= 4
  float r = xx + yy, s = 6.0 * zz - r, t = 4.0 * zz - 3.0 * r, p = 3.0 * xx - yy, q = xx - 3.0 * yy;
  c += 2.50334294179670454 * x * y * (xx - yy) * sh(16) -
       1.77013076977993053 * (y * z * p * sh(17) + x * z * q * sh(23)) +
       0.94617469575755997 * x * y * s * sh(18) - 0.66904654355728917 * (y * z * t * sh(19) + x * z * t * sh(21)) +
       0.10578554691520431 * (8.0 * zz * zz - 24.0 * zz * r + 3.0 * r * r) * sh(20) +
       0.47308734787877998 * (xx - yy) * s * sh(22) + 0.62583573544917614 * (xx * q - yy * p) * sh(24);
#endif
  return c;
}

vec3 to_linear(vec3 s) {
  return mix(pow((max(s, 0.04045) + 0.055) / 1.055, vec3(2.4)), s / 12.92, lessThanEqual(s, vec3(0.04045)));
}
vec3 to_srgb(vec3 x) {
  return mix(1.055 * pow(max(x, 0.0031308), vec3(1.0 / 2.4)) - 0.055, 12.92 * x, lessThanEqual(x, vec3(0.0031308)));
}

/// The rotation nearest to a matrix, by Newton's method on R = (R + R^-T) / 2.
mat3 nearest_rotation(mat3 M) {
  mat3 R = M * inversesqrt(max(dot(M[0], M[0]) + dot(M[1], M[1]) + dot(M[2], M[2]), 1e-12) / 3.0);
  for (int n = 0; n < 8; ++n) {
    mat3 cofactors = mat3(cross(R[1], R[2]), cross(R[2], R[0]), cross(R[0], R[1]));
    float determinant = dot(R[0], cofactors[0]);
    R = 0.5 * (R + cofactors * (1.0 / (abs(determinant) < 1e-6 ? 1e-6 : determinant)));
  }
  return R;
}

#if BODY
/// The blend of the bones: its map of points, and the matrix for covariance and direction.
void blend(out mat3 turn, out mat3 linear, out vec3 shift) {
  mat4x3 sum = mat4x3(0.0);
  vec4 real = vec4(0.0), dual = vec4(0.0), heaviest = vec4(0.0);
  float total = 0.0;
  for (int b = 0; b < BLOCKS; ++b) {
    vec4 joints = fixed_number(${joints} + b), weights = fixed_number(${weights} + b);
    for (int k = 0; k < 4; ++k) {
      float w = weights[k];
      if (w == 0.0) continue;
      int j = int(joints[k]);
      total += w;
#if DUAL
      vec4 q = texelFetch(u_bones, ivec2(2 * j, 0), 0), e = texelFetch(u_bones, ivec2(2 * j + 1, 0), 0);
      if (heaviest == vec4(0.0)) heaviest = q;
      float sign = dot(heaviest, q) < 0.0 ? -w : w;
      real += sign * q, dual += sign * e;
#else
      vec4 x = texelFetch(u_bones, ivec2(3 * j, 0), 0), y = texelFetch(u_bones, ivec2(3 * j + 1, 0), 0),
           z = texelFetch(u_bones, ivec2(3 * j + 2, 0), 0);
      sum += w * mat4x3(x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z, x.w, y.w, z.w);
#endif
    }
  }
#if DUAL
  float s = inversesqrt(max(dot(real, real), 1e-30));
  real *= s, dual *= s;
  turn = linear = rotation(real);
  shift = 2.0 * (dual.yzw * real.x - real.yzw * dual.x + cross(real.yzw, dual.yzw));
#else
  sum /= total;
  linear = mat3(sum[0], sum[1], sum[2]), shift = sum[3];
#if POLAR
  turn = nearest_rotation(linear);
#else
  turn = linear;
#endif
#endif
}
#endif

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  gaussian = (at.y - u_first_row) * WIDE + at.x;
  o_mean = o_factor = o_rest = o_color = vec4(0.0);
  if (gaussian >= u_count) return;
  vec4 place = fixed_number(0), scales = fixed_number(2);
  mat3 turn = mat3(1.0), linear = mat3(1.0);
  vec3 mean = place.xyz, shift = vec3(0.0), corners = fixed_number(3).xyz, weights = fixed_number(4).xyz;
#if BODY
  vec4 a = vertex(2.0 * corners.x), b = vertex(2.0 * corners.y), c = vertex(2.0 * corners.z);
  mean += weights.x * a.xyz + weights.y * b.xyz + weights.z * c.xyz;
  blend(turn, linear, shift);
#endif
  mean = linear * mean + shift;
  vec3 offset = mean - u_center;
#if BODY
  vec3 r0 = cross(turn[1], turn[2]), r1 = cross(turn[2], turn[0]), r2 = cross(turn[0], turn[1]);
  vec3 d = vec3(dot(r0, offset), dot(r1, offset), dot(r2, offset)) * (dot(turn[0], r0) < 0.0 ? -1.0 : 1.0);
#else
  vec3 d = offset;
#endif
  vec3 color = max(harmonics(normalize(d)) + 0.5, 0.0);
#if CLAMP_ABOVE
  color = min(color, 1.0);
#endif
  float ao = scales.w;
#if OCCLUSION_BLOCKS
  for (int b = 0; b < OCCLUSION_BLOCKS; ++b) {
    int k = gaussian * OCCLUSION_BLOCKS + b;
    ao += dot(texelFetch(u_occlusion_basis, ivec2(k % WIDE, k / WIDE), 0), u_occlusion_shares[b]);
  }
  ao = max(ao, 0.0);
#endif
  color *= mix(1.0, ao, u_occlusion);
#if LIT
  vec2 light = weights.x * vertex(2.0 * corners.x + 1.0).xy + weights.y * vertex(2.0 * corners.y + 1.0).xy +
               weights.z * vertex(2.0 * corners.z + 1.0).xy;
  color = to_srgb(to_linear(color) * light.x + light.y);
#if CLAMP_ABOVE
  color = min(color, 1.0);
#endif
#endif
  mat3 F = turn * rotation(fixed_number(1));
  F[0] *= scales.x, F[1] *= scales.y, F[2] *= scales.z;
  o_mean = vec4(mean, place.w);
  o_factor = vec4(F[0], F[1].x);
  o_rest = vec4(F[1].yz, F[2].xy);
  o_color = vec4(color, F[2].z);
}`;
  }

  /** Projects one splat per instance to a quad around its ellipse. */
  const splatVertex = (solid) => head + `
#define SOLID ${solid ? 1 : 0}
uniform sampler2D u_mean, u_factor, u_rest, u_color;
uniform vec3 u_row0, u_row1, u_row2, u_shift; // x_cam = R x + t
uniform vec4 u_lens;                          // fx, fy, cx, cy
uniform vec2 u_size;
uniform float u_dilation;
uniform bool u_compensate;
layout(location = 0) in uint a_slot;
flat out vec2 v_mean;
flat out vec4 v_shape; // a map in which the splat is round: u = x dx + y dy, v = z dy; opacity
flat out vec4 v_color; // and depth
flat out float v_bulge;

void main() {
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0); // outside
  int wide = textureSize(u_mean, 0).x;
  ivec2 at = ivec2(int(a_slot) % wide, int(a_slot) / wide);
  vec4 mean = texelFetch(u_mean, at, 0), first = texelFetch(u_factor, at, 0), rest = texelFetch(u_rest, at, 0),
       color = texelFetch(u_color, at, 0);
  vec3 p = vec3(dot(u_row0, mean.xyz), dot(u_row1, mean.xyz), dot(u_row2, mean.xyz)) + u_shift;
  if (!(p.z > 0.2)) return;
  const float margin = 0.15;
  float inverse_z = 1.0 / p.z;
  vec2 pixel = u_lens.xy * p.xy * inverse_z;
  vec2 j = clamp(pixel, -u_lens.zw - margin * u_size, u_size - u_lens.zw + margin * u_size);
  vec3 a = (u_row0 * u_lens.x - u_row2 * j.x) * inverse_z, b = (u_row1 * u_lens.y - u_row2 * j.y) * inverse_z;
  // From the factor, not from the covariance, whose determinant would be a small difference for a needle.
  mat3 F = mat3(first.x, first.y, first.z, first.w, rest.x, rest.y, rest.z, rest.w, color.w);
  vec3 along_x = a * F, along_y = b * F, normal = cross(along_x, along_y);
  vec3 sharp = vec3(dot(along_x, along_x), dot(along_x, along_y), dot(along_y, along_y));
  float dilation = SOLID == 1 ? 0.02 : u_dilation, opacity = mean.w;
  vec3 v = sharp + vec3(dilation, 0.0, dilation);
  float sharp_determinant = dot(normal, normal);
  float determinant = sharp_determinant + dilation * (sharp.x + sharp.z + dilation);
#if SOLID
  if (!(opacity >= 0.1)) return;
  float reach = 1.6 * 1.6; // squared, in standard deviations
  v_bulge = 1.6 * length(u_row2 * F);
#else
  if (u_compensate) opacity *= sqrt(max(sharp_determinant / determinant, 0.000025));
  if (!(opacity * 255.0 > 1.0)) return;
  float reach = 2.0 * log(opacity * 255.0);
  v_bulge = 0.0;
#endif
  float middle = 0.5 * (v.x + v.z), radius = length(vec2(0.5 * (v.x - v.z), v.y));
  vec2 axis = radius > 1e-6 * middle ? normalize(v.x > v.z ? vec2(0.5 * (v.x - v.z) + radius, v.y)
                                                           : vec2(v.y, 0.5 * (v.z - v.x) + radius)) : vec2(1.0, 0.0);
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
  vec2 offset = axis * (corner.x * sqrt((middle + radius) * reach)) +
                vec2(-axis.y, axis.x) * (corner.y * sqrt(determinant / (middle + radius) * reach));
  v_mean = pixel + u_lens.zw;
  v_shape = vec4(v.z * inversesqrt(determinant) * inversesqrt(v.z), -v.y * inversesqrt(determinant) * inversesqrt(v.z),
                 inversesqrt(v.z), opacity);
  v_color = vec4(color.rgb, p.z);
  vec2 place = (v_mean + offset) / u_size;
  gl_Position = vec4(2.0 * place.x - 1.0, 1.0 - 2.0 * place.y, 0.0, 1.0);
}`;

  const splatFragment = (solid) => head + `
#define SOLID ${solid ? 1 : 0}
uniform vec2 u_size;
flat in vec2 v_mean;
flat in vec4 v_shape, v_color;
flat in float v_bulge;
out vec4 o_color;

void main() {
  vec2 d = vec2(gl_FragCoord.x, u_size.y - gl_FragCoord.y) - v_mean;
  vec2 unit = vec2(v_shape.x * d.x + v_shape.y * d.y, v_shape.z * d.y);
  float q = dot(unit, unit);
#if SOLID
  float squared = 1.0 - q / (1.6 * 1.6);
  if (!(squared >= 0.0)) discard;
  float s = sqrt(squared), depth = v_color.w - s * v_bulge;
  gl_FragDepth = clamp(1.0 - 0.1 / max(depth, 0.1), 0.0, 1.0);
  o_color = vec4(v_color.rgb * (0.35 + 0.65 * s), 1.0);
#else
  float alpha = min(v_shape.w * exp(-0.5 * q), 0.99);
  if (!(alpha >= 1.0 / 255.0)) discard;
  o_color = vec4(v_color.rgb * alpha, alpha);
#endif
}`;

  /** Puts the blended picture over the background. */
  const copyFragment = head + `
uniform sampler2D u_picture;
uniform vec3 u_background;
out vec4 o_color;
void main() {
  vec4 c = texelFetch(u_picture, ivec2(gl_FragCoord.xy), 0);
  o_color = vec4(c.rgb + (1.0 - c.a) * u_background, 1.0);
}`;

  return { cover, pose, splatVertex, splatFragment, copyFragment };
})();
