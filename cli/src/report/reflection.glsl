#version 300 es
precision highp float;
precision highp sampler2D;
// {{constants}}

uniform sampler2D shape;     // two slopes of the normal, roughness
uniform sampler2D diffuse;   // linear albedo
uniform sampler2D specular;  // linear F0
uniform vec3 camera;         // mm, as the light
uniform vec3 light;
uniform float exposure;

in vec2 texel;               // 0 to 1, row 0 first
in vec3 position;            // mm
out vec4 colour;

// BRDF times the cosine of the light.
vec3 reflection(vec3 n, float rough, vec3 kd, vec3 ks, vec3 l, vec3 v) {
  vec3 sum = l + v;
  float length2 = max(dot(sum, sum), 4.0 * MIN_COSINE * MIN_COSINE);
  vec3 h = sum * inversesqrt(length2);
  float vh = 0.5 * sqrt(length2);
  float fresnel = exp2((FRESNEL_A * vh + FRESNEL_B) * vh);

  float nl = max(dot(n, l), MIN_COSINE);
  float nv = max(dot(n, v), MIN_COSINE);
  float raw = dot(n, h);
  float nh = max(raw, MIN_COSINE);
  float clamped = max(rough, MIN_ROUGHNESS);
  float alpha = clamped * clamped;
  float alpha2 = alpha * alpha;
  float k = 0.5 * alpha;
  // NoH² (alpha² - 1) + 1, where single precision would lose the difference.
  vec3 across = cross(n, h);
  float sin2 = raw > MIN_COSINE ? dot(across, across) : 1.0 - MIN_COSINE * MIN_COSINE;
  float den = nh * nh * alpha2 + sin2;
  float shadow = (nl * (1.0 - k) + k) * (nv * (1.0 - k) + k);
  float lobe = alpha2 / (4.0 * PI * den * den * shadow);
  return (kd / PI + lobe * (ks + (1.0 - ks) * fresnel)) * nl;
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
  vec3 radiance = PI * reflection(n, surface.z, kd, ks, l, v);
  colour = vec4(srgb(exposure * radiance), 1.0);
}
