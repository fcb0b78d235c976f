#version 300 es
precision highp float;
precision highp sampler2D;
// {{constants}}

uniform sampler2D shape;     // two slopes of the normal, roughness
uniform sampler2D diffuse;   // linear albedo
uniform sampler2D specular;  // linear F0
uniform sampler2D lobes;     // ln(alpha along / across) times cosine and sine of twice the angle; coat: weight, roughness
uniform sampler2D sheen;     // linear colour of the sheen, its roughness
uniform vec3 camera;         // mm, as the light
uniform vec3 light;
uniform float exposure;

in vec2 texel;               // 0 to 1, row 0 first
in vec3 position;            // mm
out vec4 colour;

// D G / (4 NoL NoV) of a lobe; sin2: 1 - NoH².
float microfacets(float rough, float nl, float nv, float nh, float sin2) {
  float clamped = max(rough, MIN_ROUGHNESS);
  float alpha = clamped * clamped;
  float alpha2 = alpha * alpha;
  float k = 0.5 * alpha;
  // NoH² (alpha² - 1) + 1, where single precision would lose the difference.
  float den = nh * nh * alpha2 + sin2;
  float shadow = (nl * (1.0 - k) + k) * (nv * (1.0 - k) + k);
  return alpha2 / (4.0 * PI * den * den * shadow);
}

// The square of the half vector's part across the normal, stretched by anisotropy.
float stretched(vec2 anisotropy, vec3 n, vec3 h) {
  float nh = dot(n, h);
  vec2 across = vec2(h.x - n.x * nh, n.z * h.y - n.y * h.z) * inversesqrt(1.0 - n.x * n.x);
  float m = length(anisotropy);
  float sinhc = m < 0.01 ? 1.0 + m * m / 6.0 : sinh(m) / m;
  vec2 turned = vec2(across.x * across.x - across.y * across.y, 2.0 * across.x * across.y);
  return cosh(m) * dot(across, across) - sinhc * dot(anisotropy, turned);
}

// Reflection of white sheen, and its directional albedo.
vec2 charlie(float rough, float nl, float nv, float sin2) {
  float r = max(rough, MIN_SHEEN_ROUGHNESS);
  float exponent = 1.0 / (r * r);
  float density = (2.0 + exponent) * pow(max(sin2, SHEEN_MIN_SIN2), 0.5 * exponent) / (2.0 * PI);
  float c = min(nl, nv);
  vec3 linear = vec3(1.0, c, r), squares = vec3(c * r, c * c, r * r);
  float top = dot(SHEEN_TOP, linear) + dot(SHEEN_TOP_SQUARES, squares);
  float bottom = dot(SHEEN_BOTTOM, linear) + dot(SHEEN_BOTTOM_SQUARES, squares);
  float albedo = clamp(top / bottom, 0.0, SHEEN_MAX_ALBEDO);
  return vec2(density / (4.0 * (nl + nv - nl * nv)), albedo);
}

// BRDF times the cosine of the light.
vec3 reflection(vec3 n, float rough, vec3 kd, vec3 ks, vec4 optional, vec4 fuzz, vec3 l, vec3 v) {
  vec3 sum = l + v;
  float length2 = max(dot(sum, sum), 4.0 * MIN_COSINE * MIN_COSINE);
  vec3 h = sum * inversesqrt(length2);
  float vh = 0.5 * sqrt(length2);
  float fresnel = exp2((FRESNEL_A * vh + FRESNEL_B) * vh);

  float nl = max(dot(n, l), MIN_COSINE);
  float nv = max(dot(n, v), MIN_COSINE);
  float raw = dot(n, h);
  float nh = max(raw, MIN_COSINE);
  vec3 across = cross(n, h);
  bool beside = raw <= MIN_COSINE;
  float sin2 = beside ? 1.0 - MIN_COSINE * MIN_COSINE : dot(across, across);
  float base = microfacets(rough, nl, nv, nh, beside ? sin2 : stretched(optional.xy, n, h));
  float coat = microfacets(optional.w, nl, nv, nh, sin2);
  float reflected = optional.z * (COAT_F0 + (1.0 - COAT_F0) * fresnel);
  vec3 below = kd / PI + base * (ks + (1.0 - ks) * fresnel);
  float most = max(fuzz.r, max(fuzz.g, fuzz.b));
  if (most > 0.0) {
    vec2 white = charlie(fuzz.a, nl, nv, sin2);
    below = below * (1.0 - most * white.y) + fuzz.rgb * white.x;
  }
  return ((1.0 - reflected) * below + reflected * coat) * nl;
}

vec3 srgb(vec3 linear) {
  vec3 v = clamp(linear, 0.0, 1.0);
  vec3 curve = 1.055 * pow(max(v, 1e-6), vec3(1.0 / 2.4)) - 0.055;
  return mix(12.92 * v, curve, step(0.0031308, v));
}

void main() {
  vec3 surface = texture(shape, texel).xyz;
  vec3 n = normalize(vec3(surface.xy, 1.0));
  vec3 kd = texture(diffuse, texel).rgb;
  vec3 ks = texture(specular, texel).rgb;
  vec3 l = normalize(light - position);
  vec3 v = normalize(camera - position);
  // A light of power pi: white paper that faces it comes out white.
  vec3 radiance = PI * reflection(n, surface.z, kd, ks, texture(lobes, texel), texture(sheen, texel), l, v);
  colour = vec4(srgb(exposure * radiance), 1.0);
}
