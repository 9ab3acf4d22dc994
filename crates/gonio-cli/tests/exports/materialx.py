"""Checks an exported MaterialX document with the MaterialX library: validates it and generates a shader.

    python3 materialx.py OPENPBR.mtlx
"""

import sys

import MaterialX as mx
from MaterialX import PyMaterialXGenGlsl, PyMaterialXGenShader


def main(path):
    library = mx.createDocument()
    search = mx.getDefaultDataSearchPath()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), search, library)
    document = mx.createDocument()
    mx.readFromXmlFile(document, path)
    document.setDataLibrary(library)
    valid, message = document.validate()
    assert valid, f"{path}: {message}"
    materials = document.getMaterialNodes()
    assert len(materials) == 1, f"{path}: {len(materials)} materials"
    [surface] = mx.getShaderNodes(materials[0])
    assert surface.getCategory() == "open_pbr_surface", surface.getCategory()
    definition = surface.getNodeDef()
    assert definition is not None, f"{path}: no definition of {surface.getCategory()}"
    # MaterialX ignores inputs with unknown names without an error.
    for given in surface.getInputs():
        known = definition.getActiveInput(given.getName())
        assert known is not None, f"{path}: no input {given.getName()}"
        assert known.getType() == given.getType(), f"{path}: {given.getName()} is a {known.getType()}"
    generator = PyMaterialXGenGlsl.GlslShaderGenerator.create()
    context = PyMaterialXGenShader.GenContext(generator)
    context.registerSourceCodeSearchPath(search)
    shader = generator.generate(surface.getName(), materials[0], context)
    source = shader.getSourceCode(PyMaterialXGenShader.PIXEL_STAGE)
    assert "void main()" in source
    print(f"{path}: valid, {len(surface.getInputs())} inputs, shader with {len(source.splitlines())} lines")


if __name__ == "__main__":
    main(sys.argv[1])
