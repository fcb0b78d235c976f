"""Validates USDZ packages with every validator of usd-core, and MaterialX documents by validation
and generation of GLSL: validate.py FILES..."""
import os
import sys
import zipfile

import MaterialX as mx
import MaterialX.PyMaterialXGenGlsl as mx_glsl
import MaterialX.PyMaterialXGenShader as mx_shader
from pxr import Usd, UsdShade, UsdValidation


def usdz(path):
    registry = UsdValidation.ValidationRegistry()
    validators = registry.GetOrLoadAllValidators()
    context = UsdValidation.ValidationContext(validators)
    stage = Usd.Stage.Open(path)
    # usd-core does not know MaterialX, see open_pbr().
    errors = [e for e in context.Validate(stage) if e.GetName() != "MissingShaderIdInRegistry" or "'ND_" not in e.GetMessage()]
    findings = [f"{e.GetName()}: {e.GetMessage()}" for e in errors]
    # Quick Look reads stored data where it lies.
    for entry in zipfile.ZipFile(path).infolist():
        with open(path, "rb") as file:
            file.seek(entry.header_offset + 26)
            name, extra = (int.from_bytes(file.read(2), "little") for _ in range(2))
        start = entry.header_offset + 30 + name + extra
        if entry.compress_type != zipfile.ZIP_STORED or start % 64:
            findings.append(f"{entry.filename}: not stored at a multiple of 64 bytes")
    bad = zipfile.ZipFile(path).testzip()
    if bad:
        findings.append(f"{bad}: wrong checksum")
    # Every input of the surface ends in a texture that can be opened.
    surface = UsdShade.Shader(stage.GetPrimAtPath("/Sample/Looks/Surface/Preview"))
    coat = [name for name in ["clearcoat", "clearcoatRoughness"] if surface.GetInput(name)]
    for name in ["diffuseColor", "metallic", "roughness", "normal", "occlusion", *coat]:
        source = surface.GetInput(name).GetConnectedSources()[0][0].source
        asset = UsdShade.Shader(source.GetPrim()).GetInput("file").Get()
        if not asset.resolvedPath:
            findings.append(f"{name}: {asset.path} cannot be found")
    findings += open_pbr(stage)
    return f"{len(validators)} validators", findings


def open_pbr(stage):
    """Every node of the MaterialX network has the inputs, outputs and types of MaterialX's library."""
    library = mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
    types = {"color3": "color3f", "vector3": "float3", "vector2": "float2", "filename": "asset", "surfaceshader": "token"}
    material = UsdShade.Material(stage.GetPrimAtPath("/Sample/Looks/Surface"))
    source = material.ComputeSurfaceSource("mtlx")[0]
    findings, left, seen = [], [source.GetPrim()], set()
    while left:
        prim = left.pop()
        if prim in seen:
            continue
        seen.add(prim)
        shader = UsdShade.Shader(prim)
        definition = library.getNodeDef(shader.GetIdAttr().Get())
        if definition is None:
            findings.append(f"{prim.GetName()}: {shader.GetIdAttr().Get()} is not known")
            continue
        for port in [*shader.GetInputs(), *shader.GetOutputs()]:
            known = definition.getActiveInput(port.GetBaseName()) or definition.getActiveOutput(port.GetBaseName())
            kind = known and types.get(known.getType(), known.getType())
            if kind != str(port.GetTypeName()):
                findings.append(f"{prim.GetName()}.{port.GetBaseName()}: {port.GetTypeName()}, not {kind}")
        for port in shader.GetInputs():
            if port.GetBaseName() == "file" and not port.Get().resolvedPath:
                findings.append(f"{prim.GetName()}: {port.Get().path} cannot be found")
            for connected in port.GetConnectedSources()[0]:
                output = connected.source.GetOutput(connected.sourceName)
                if not output or output.GetTypeName() != port.GetTypeName():
                    findings.append(f"{prim.GetName()}.{port.GetBaseName()}: connected to nothing of its type")
                left.append(connected.source.GetPrim())
    if len(seen) < 7:
        findings.append(f"OpenPBR: {len(seen)} nodes")
    return findings


def materialx(path):
    library = mx.createDocument()
    search = mx.getDefaultDataSearchPath()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), search, library)
    document = mx.createDocument()
    mx.readFromXmlFile(document, path)
    document.setDataLibrary(library)
    valid, message = document.validate()
    findings = [] if valid else [message]
    # The data library has node graphs of its own.
    for image in document.getNodeGraph("svbrdf_maps").getNodes("image"):
        file = image.getInput("file").getValueString()
        if not os.path.isfile(os.path.join(os.path.dirname(path), file)):
            findings.append(f"{file} cannot be found")
    # The context does not keep the generator alive.
    generator = mx_glsl.GlslShaderGenerator.create()
    context = mx_shader.GenContext(generator)
    context.registerSourceCodeSearchPath(search)
    colors = mx_shader.DefaultColorManagementSystem.create(generator.getTarget())
    colors.loadLibrary(library)
    generator.setColorManagementSystem(colors)
    materials = document.getMaterialNodes()
    if len(materials) != 2:
        findings.append(f"{len(materials)} materials, 2 expected")
    for material in materials:
        shader = generator.generate(material.getName(), material, context)
        lines = shader.getSourceCode("pixel").count("\n")
        if lines < 100:
            findings.append(f"{material.getName()}: {lines} lines of GLSL")
    return f"validation and GLSL of {len(materials)} materials", findings


def main():
    failed = False
    for path in sys.argv[1:]:
        what, findings = (usdz if path.endswith(".usdz") else materialx)(path)
        print(f"{path}: {what}: {len(findings)} findings")
        for finding in findings:
            print(f"  {finding}")
        failed |= bool(findings)
    sys.exit(failed)


main()
