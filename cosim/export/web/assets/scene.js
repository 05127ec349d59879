class SceneView { constructor(){} draw(){} describe(){return "";} }
